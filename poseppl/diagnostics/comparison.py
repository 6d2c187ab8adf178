"""Runs of the same data side by side: mixing, cost, error and coverage, who wins where, and variance against time.

>>> from poseppl.runs.results import Names, build_result
>>> rng = np.random.default_rng(0)
>>> draws = {"short": rng.standard_normal((4, 50, 3, 1)), "long": rng.standard_normal((4, 800, 3, 1))}
>>> runs = {name: build_result(state=z, names=Names(("level",)), attrs={"wall_seconds": 0.3}) for name, z in draws.items()}
>>> comparison = compare(runs)
>>> comparison["figures/tau"].dims, comparison["winner/winner"].sel(quantity="ess_per_second").item()
(('run', 'frame', 'dof'), 'long')
>>> comparison_table(comparison)[0]["run"]
'short'
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.calibration import coverage
from poseppl.diagnostics.evidence import evidence_of_run, evidences
from poseppl.diagnostics.paired_comparison import TIE, compare_quantities, is_miscalibrated
from poseppl.diagnostics.replicates import variance_against_time
from poseppl.diagnostics.run_figures import figures_of_run
from poseppl.diagnostics.same_data import Data, data_of, difference, other_cameras
from poseppl.errors import InputError
from poseppl.runs.results import provenance

_BY_CELL = ("tau", "ess", "ess_per_second", "ess_per_evaluation", "rhat", "error", "error_over_sd")
_BY_FRAME = ("rejection", "evaluations", "joint_error", "joint_error_relative")


def compare(runs: Mapping[str, xr.DataTree], *, files: Mapping[str, str | PathLike[str]] | None = None) -> xr.DataTree:
    """Compare runs of any filters or smoothers on the same data, or of other cameras that saw the same truth.

    Args:
        runs: Results by name, read one after another, so that a mapping that loads them need not hold them all.
        files: Where each was read from, for messages.

    Returns:
        A tree of groups with the coordinates ``run``, ``frame``, ``dof``, ``level``, ``quantity`` and ``setting``:

        * ``figures``: see :mod:`poseppl.diagnostics.run_figures`, with a dimension ``run``;
        * ``summary``: over the frames, by ``run`` and ``dof``: means of ``tau`` and ``error``, the median of
          ``error_over_sd``, harmonic means of ``ess``, ``ess_per_second`` and ``ess_per_evaluation``, the largest ``rhat``,
          and ``coverage`` with ``coverage_se`` by level; the same for all degrees of freedom together with ``_all`` behind
          the name; the median ``tau_median_all``; means ``rejection_all``, ``evaluations_all``, ``joint_error_all`` and
          ``joint_error_relative_all``; and who is ``miscalibrated``, and left out of comparisons of ESS;
        * ``winner`` and ``winner_by_dof``: see :func:`poseppl.diagnostics.paired_comparison.compare_quantities`;
        * ``variance``: see :func:`poseppl.diagnostics.replicates.variance_against_time`;
        * ``evidence``: see :func:`poseppl.diagnostics.evidence.evidences`.

        The attributes ``frames`` and ``provenance`` hold, as JSON, how many frames there are and what each run was, and
        ``other_cameras`` which runs saw the truth through other cameras than the first one.

    Raises:
        InputError: Fewer than two runs, or runs of different data.
    """
    if len(runs) < 2:
        raise InputError(f"{len(runs)} run to compare", expected="two or more")
    if TIE in runs or "" in runs:
        raise InputError(f"a run is called {TIE!r}" if TIE in runs else "a run has no name", expected="another name")
    first: tuple[str, Data] | None = None
    parts, found, known, seen_otherwise = [], [], {}, []
    for name, tree in runs.items():
        data = data_of(tree)
        if first is None:
            first = name, data
        else:
            _check(name, data, *first, files or {})
            seen_otherwise += [name] if other_cameras(first[1], data) else []
        parts.append(figures_of_run(tree))
        found.append(evidence_of_run(tree))
        known[name] = provenance(tree)
    figures = xr.concat(parts, dim="run").assign_coords(run=list(runs))
    summary = summarise(figures)
    overall, each = compare_quantities(figures, summary["miscalibrated"].values)
    groups = {
        "figures": figures,
        "summary": summary,
        "winner": overall,
        "winner_by_dof": each,
        "variance": variance_against_time(figures),
        "evidence": evidences(found, figures),
    }
    result = xr.DataTree.from_dict(groups)
    result.attrs = {
        "frames": figures.sizes["frame"],
        "provenance": json.dumps(known),
        "other_cameras": json.dumps(seen_otherwise),
    }
    return result


def summarise(figures: xr.Dataset) -> xr.Dataset:
    """Sum figures up over the frames; see :func:`compare`.

    Args:
        figures: The figures of all runs, with a dimension ``run``.
    """
    data: dict[str, Any] = {}
    for name in _BY_CELL:
        values = figures[name].transpose("run", "dof", "frame").values
        form = _FORMS.get(name, np.nanmean)
        data[name] = (("run", "dof"), _reduced(form, values))
        data[f"{name}_all"] = (("run",), _reduced(form, values.reshape(len(values), -1)))
    tau = figures["tau"].transpose("run", "dof", "frame").values
    data["tau_median_all"] = (("run",), _reduced(np.nanmedian, tau.reshape(len(tau), -1)))
    for name in _BY_FRAME:
        data[f"{name}_all"] = (("run",), _reduced(np.nanmean, figures[name].transpose("run", "frame").values))
    inside = figures["inside"].transpose("run", "level", "dof", "frame").values
    levels = figures["level"].values
    cells = np.array([[[_coverage(cell, q) for cell in row] for row, q in zip(run, levels, strict=True)] for run in inside])
    whole = np.array([[_coverage(row.T, q) for row, q in zip(run, levels, strict=True)] for run in inside])
    for index, name in enumerate(("coverage", "coverage_se")):
        data[name] = (("run", "level", "dof"), cells[..., index])
        data[f"{name}_all"] = (("run", "level"), whole[..., index])
    ninety = int(np.argmin(np.abs(levels - 0.9)))
    data["miscalibrated"] = (("run",), is_miscalibrated(whole[:, ninety, 0], whole[:, ninety, 1]))
    return xr.Dataset(data, coords={name: figures[name].values for name in ("run", "dof", "level")})


def comparison_table(tree: xr.DataTree) -> list[dict[str, Any]]:
    """List a comparison, one row for each run, frame and degree of freedom.

    Args:
        tree: Of :func:`compare`.

    Returns:
        Rows of ``run``, ``frame``, ``dof``, the figures by their names, ``inside_50``, ``inside_80`` and ``inside_90``; figures
        of a whole frame are repeated on each of its rows. What a run has no figure for is None.
    """
    figures = tree["figures"].dataset
    dims = ("run", "frame", "dof")
    shape = tuple(figures.sizes[dim] for dim in dims)
    columns: dict[str, Any] = {
        dim: figures[dim].values.reshape([-1 if dim == other else 1 for other in dims]).astype(object) for dim in dims
    }
    columns |= {name: _or_none(figures[name].transpose(*dims).values) for name in _BY_CELL}
    columns |= {name: _or_none(figures[name].transpose("run", "frame").values[:, :, None]) for name in _BY_FRAME}
    inside = figures["inside"].transpose("level", *dims).values
    columns |= {f"inside_{100 * q:.0f}": _or_none(values) for q, values in zip(figures["level"].values, inside, strict=True)}
    flat = [np.broadcast_to(values, shape).ravel().tolist() for values in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*flat, strict=True)]


def _check(name: str, data: Data, first: str, reference: Data, files: Mapping[str, str | PathLike[str]]) -> None:
    problem = difference(reference, data)
    if problem is not None:
        other = files.get(first, first)
        raise InputError(
            f"a run of other data: {problem} in {other}",
            file=files.get(name, name),
            expected="runs of the same points, frames and coordinates; the noise of simulated points depends on --seed",
        )


def _or_none(values: Any) -> Any:
    return np.where(np.isfinite(values), values.astype(object), None)


def _reduced(form: Any, values: Any) -> Any:
    """Reduce the last axis over what is finite; NaN where nothing is."""
    empty = ~np.isfinite(values).any(axis=-1)
    filled = np.where(np.isfinite(values), values, np.nan)
    filled[empty] = 1.0
    return np.where(empty, np.nan, form(filled, axis=-1))


def _harmonic(values: Any, axis: int) -> Any:
    return 1 / np.nanmean(1 / values, axis=axis)


def _coverage(inside: Any, level: float) -> tuple[float, float]:
    found = coverage(np.where(np.isfinite(inside), inside, 0.0), float(level), valid=np.isfinite(inside))
    return found.estimate, found.standard_error


_FORMS: dict[str, Any] = {"rhat": np.nanmax, "error_over_sd": np.nanmedian} | dict.fromkeys(
    ("ess", "ess_per_second", "ess_per_evaluation"), _harmonic
)
