"""Runs of the same data side by side: mixing, cost, error and coverage, winners by coordinate, and variance against time.

>>> from poseppl.runs.results import Names, build_result
>>> rng = np.random.default_rng(0)
>>> draws = {"short": rng.standard_normal((4, 50, 3, 1)), "long": rng.standard_normal((4, 800, 3, 1))}
>>> runs = {name: build_result(state=z, names=Names(("level",)), attrs={"wall_seconds": 0.3}) for name, z in draws.items()}
>>> comparison = compare(runs)
>>> comparison["figures/tau"].dims, comparison["winner/winner"].sel(quantity="ess_per_second").item()
(('run', 'frame', 'state_dim'), 'long')
>>> comparison_table(comparison)[0]["run"]
'short'

Whether results are of the same data: the same frames, observed values and truth; without values the same coordinates.

>>> from poseppl.runs.results import Names, build_result
>>> first, second = (build_result(state=np.zeros((1, 4, frames, 1)), names=Names(("level",))) for frames in (3, 5))
>>> difference(data_of(first), data_of(second))
'frames 0-4, but frames 0-2'
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.arrays import Integers
from poseppl.diagnostics.batches import mean_interval
from poseppl.diagnostics.calibration import coverage
from poseppl.diagnostics.forecasts import forecasts_of_runs
from poseppl.diagnostics.paired_comparison import TIE, compare_quantities, is_miscalibrated
from poseppl.diagnostics.replicates import evidence_of_run, evidences, variance_against_time
from poseppl.diagnostics.run_figures import figures_of_run
from poseppl.diagnostics.verdicts import frame_ranges
from poseppl.errors import FilePath, InputError
from poseppl.runs.contents import arrays_of, frame_numbers, group_of, names_of
from poseppl.runs.results import provenance

COSTS = ("ess_per_second", "ess_per_gradient", "ess_per_evaluation")
_BY_CELL = ("tau", "tau_se", "ess", *COSTS, "rhat", "error", "error_over_sd")
_BY_FRAME = ("rejection", "evaluations", "joint_error", "joint_error_relative")


def compare(runs: Mapping[str, xr.DataTree], *, files: Mapping[str, FilePath] | None = None) -> xr.DataTree:
    """Compare runs of any filters or smoothers on the same data, or of other cameras that saw the same truth.

    Models of other coordinates are compared by evidence and forecasts, and in the coordinates that they share.

    Args:
        runs: Results by name, read one after another, so that a mapping can load them one at a time.
        files: The file of each, for messages.

    Returns:
        A tree of groups with the coordinates ``run``, ``frame``, ``state_dim``, ``level``, ``quantity`` and ``setting``:

        * ``figures``: see :mod:`poseppl.diagnostics.run_figures`, with a dimension ``run``;
        * ``summary``: statistics over the frames, by ``run`` and ``state_dim``. Means: ``tau`` (its standard error ``tau_se``
          by batches of frames) and ``error``. Medians: ``error_over_sd``. Harmonic means: ``ess``, ``ess_per_second``,
          ``ess_per_gradient`` and ``ess_per_evaluation``. Maxima: ``rhat``. By level: ``coverage`` with ``coverage_se``. The
          suffix ``_all`` marks statistics of all degrees of freedom together. Further statistics are the median
          ``tau_median_all`` and the means ``rejection_all``, ``evaluations_all``, ``joint_error_all`` and
          ``joint_error_relative_all``. Runs that are ``miscalibrated`` are left out of comparisons of ESS;
        * ``winner`` and ``winner_by_state_dim``: see :func:`poseppl.diagnostics.paired_comparison.compare_quantities`;
        * ``variance``: see :func:`poseppl.diagnostics.replicates.variance_against_time`;
        * ``evidence``: see :func:`poseppl.diagnostics.replicates.evidences`;
        * ``forecasts``: see :func:`poseppl.diagnostics.forecasts.forecasts_of_runs`.

        The attributes are JSON: ``frames`` is the number of frames, ``provenance`` describes each run, and ``other_cameras``
        lists the runs that saw the truth through other cameras than the first one.

    Raises:
        InputError: Fewer than two runs, or runs of different data.
    """
    if len(runs) < 2:
        raise InputError(f"{len(runs)} run to compare", expected="two or more")
    if TIE in runs or "" in runs:
        raise InputError(f"a run is called {TIE!r}" if TIE in runs else "a run has no name", expected="another name")
    first: tuple[str, Data] | None = None
    parts, found, known, seen_otherwise, forecast_runs = [], [], {}, [], {}
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
        forecast_runs[name] = group_of(tree, "hindcasts")
    coordinates = list(dict.fromkeys(name for part in parts for name in part["state_dim"].values.tolist()))
    aligned = [part.reindex(state_dim=coordinates) for part in parts]
    figures = xr.concat(aligned, dim="run", join="exact").assign_coords(run=list(runs))
    summary = summarise(figures)
    overall, each = compare_quantities(figures, summary["miscalibrated"])
    groups = {
        "figures": figures,
        "summary": summary,
        "winner": overall,
        "winner_by_state_dim": each,
        "variance": variance_against_time(figures),
        "evidence": evidences(found, figures),
        "forecasts": forecasts_of_runs(forecast_runs),
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
    cells, frames = (_finite(figures[list(names)]) for names in (_BY_CELL, _BY_FRAME))
    data = over_frames(cells) | {f"{name}_all": each for name, each in over_frames(cells, "state_dim").items()}
    data["tau_median_all"] = cells["tau"].median(("frame", "state_dim"))
    data |= {f"{name}_all": values.mean("frame") for name, values in frames.items()}
    for ending, trials in (("", ["frame"]), ("_all", ["frame", "state_dim"])):
        data[f"coverage{ending}"], data[f"coverage_se{ending}"] = xr.apply_ufunc(
            _coverage,
            figures["inside"],
            figures["level"],
            input_core_dims=[trials, []],
            output_core_dims=[[], []],
            vectorize=True,
        )
    ninety = [data[f"coverage{part}_all"].sel(level=0.9, method="nearest").values for part in ("", "_se")]
    return xr.Dataset(data).assign(miscalibrated=("run", is_miscalibrated(*ninety)))


def over_frames(figures: xr.Dataset, *more: str) -> dict[str, xr.DataArray]:
    """Sum the figures of cells up over the frames, and over more dimensions; see :func:`compare`."""
    dims = ["frame", *more]
    data = {name: _FORMS.get(name, xr.DataArray.mean)(figures[name], dims) for name in _BY_CELL}
    error = xr.apply_ufunc(
        lambda tau: mean_interval(tau).standard_error, figures["tau"], input_core_dims=[dims], vectorize=True
    )
    return data | {"tau_se": error.fillna(data["tau_se"])}


def comparison_table(tree: xr.DataTree) -> list[dict[str, Any]]:
    """List a comparison, one row for each run, frame and degree of freedom.

    Args:
        tree: The tree of :func:`compare`.

    Returns:
        Rows of ``run``, ``frame``, ``state_dim``, the figures by their names, ``inside_50``, ``inside_80`` and ``inside_90``;
        figures of a whole frame are repeated on each of its rows. None stands for a figure that a run does not have.
    """
    figures = tree["figures"].dataset
    inside = figures["inside"].assign_coords(level=[f"inside_{100 * q:.0f}" for q in figures["level"].values])
    columns = _finite(figures[[*_BY_CELL, *_BY_FRAME]]).assign(inside.to_dataset("level"))
    rows = columns.to_dataframe(dim_order=["run", "frame", "state_dim"]).reset_index().to_dict("records")
    return [{str(name): None if value != value else value for name, value in row.items()} for row in rows]


def _check(name: str, data: Data, first: str, reference: Data, files: Mapping[str, FilePath]) -> None:
    problem = difference(reference, data)
    if problem is not None:
        other = files.get(first, first)
        raise InputError(
            f"a run of other data: {problem} in {other}",
            file=files.get(name, name),
            expected="runs of the same points, frames and coordinates; the noise of simulated points depends on the seed",
        )


def _finite(figures: xr.Dataset) -> xr.Dataset:
    return figures.where(np.isfinite(figures))


def _harmonic(values: xr.DataArray, dims: Any) -> xr.DataArray:
    return 1 / (1 / values).mean(dims)


def _coverage(inside: Any, level: float) -> tuple[float, float]:
    return coverage(inside, level, valid=np.isfinite(inside))[1:3]


_FORMS: dict[str, Any] = {"rhat": xr.DataArray.max, "error_over_sd": xr.DataArray.median} | dict.fromkeys(
    ("ess", *COSTS), _harmonic
)


_TOLERANCE = 1e-5
"""Tolerance, as a share of the largest observed value: above what a text file rounds off, far below any noise."""


class Data(NamedTuple):
    """Data that runs must share.

    Attributes:
        frames: Frame numbers (frame,).
        dofs: Names of the degrees of freedom.
        observed: The data by name, (frame, ...) each, NaN where missing.
        truth: The truth by name, (frame, ...) each; empty where it is not known.
        cameras: Names and calibration of the cameras, by name; empty where there are none.
    """

    frames: Integers
    dofs: tuple[str, ...]
    observed: dict[str, NDArray[Any]]
    truth: dict[str, NDArray[Any]]
    cameras: dict[str, NDArray[Any]]


def data_of(tree: xr.DataTree) -> Data:
    """Find the data of a result.

    Args:
        tree: The result.
    """
    cameras = {str(name): values.values for name, values in group_of(tree, "camera").variables.items()}
    observed, truth = (arrays_of(tree, group) for group in ("observed_data", "truth"))
    return Data(frame_numbers(tree), tuple(names_of(tree, "state_dim")), observed, truth, cameras)


def difference(first: Data, second: Data) -> str | None:
    """Say in what the second differs from the first.

    A truth that only one of them knows is no difference, and neither are other coordinates of models of the same observed
    values. Runs that saw one truth through other cameras are of the same data.

    Args:
        first: Data of one result.
        second: Data of another.

    Returns:
        "THIS, but THAT", this of the second and that of the first; None if they are the same.
    """
    return next(_differences(first, second), None)


def _differences(first: Data, second: Data) -> Iterator[str]:
    """Say in what they differ; what comes behind other frames is not to be read."""
    if second.dofs != first.dofs and not (first.observed and second.observed):
        yield _different_dofs(first.dofs, second.dofs)
    if not np.array_equal(first.frames, second.frames):
        yield f"{frame_ranges(second.frames.tolist())}, but {frame_ranges(first.frames.tolist())}"
    if not other_cameras(first, second):
        if set(first.observed) != set(second.observed):
            yield f"observed {_listed(second.observed)}, but {_listed(first.observed)}"
        for name, values in first.observed.items():
            yield from _different_values(f"observed {name}", values, second.observed[name], first.frames)
    of_coordinates = set() if second.dofs == first.dofs else {"state"}
    for name in (first.truth.keys() & second.truth.keys()) - of_coordinates:
        yield from _different_values(f"true {name}", first.truth[name], second.truth[name], first.frames)


def other_cameras(first: Data, second: Data) -> bool:
    """Whether two runs saw something whose truth both know through cameras that differ in number, name or calibration."""
    if not (first.cameras and second.cameras and first.truth.keys() & second.truth.keys()):
        return False
    names = first.cameras.keys() & second.cameras.keys()
    return not all(np.array_equal(first.cameras[name], second.cameras[name]) for name in names)


def _listed(names: dict[str, Any]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _different_dofs(first: tuple[str, ...], second: tuple[str, ...]) -> str:
    if len(first) != len(second):
        return f"{len(second)} coordinates, but {len(first)}"
    place = next(i for i, (one, other) in enumerate(zip(first, second, strict=True)) if one != other)
    return f"coordinate {second[place]!r}, but {first[place]!r}"


def _different_values(label: str, first: NDArray[Any], second: NDArray[Any], frames: Integers) -> Iterator[str]:
    if first.shape != second.shape:
        yield f"{label} of shape {second.shape}, but {first.shape}"
    elif first.dtype.kind not in "fiub" or second.dtype.kind not in "fiub":
        if not np.array_equal(first, second):
            yield f"other {label}, but the same name"
    else:
        one, other = np.asarray(first, np.float64), np.asarray(second, np.float64)
        scale = np.abs(one[np.isfinite(one)]).max(initial=0.0)
        same = np.isclose(other, one, rtol=0.0, atol=_TOLERANCE * scale, equal_nan=True)
        wrong = ~same.reshape(len(frames), -1).all(axis=1)
        if wrong.any():
            yield f"other {label} in {frame_ranges(frames[wrong].tolist())}, but the same frames"
