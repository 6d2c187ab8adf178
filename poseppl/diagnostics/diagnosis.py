"""All diagnostics of a result, as one more group of its tree; and packages that add to those of their own results.

For Markov chains ``tau``, its standard error ``tau_se``, ``tau_windowed``, ``ess``, ``rhat`` and ``mcse`` (frame, state_dim)
and ``autocorrelation`` (lag, frame, state_dim) come from the draws in the result: where it has every k-th draw, they refer
to those. For weighted particles the stored draws are a resampled thinning and contain no such information; ``ess`` is the
effective number of each frame (Choo and Fleet 2001, Eq. 6), the same for every degree of freedom, and ``tau`` the number of
particles over it. ``rejection_rate`` (frame,) is one minus the acceptance rate. Against a truth there are also ``inside``
(level, frame, state_dim), ``probability_transform`` (frame, state_dim), and the coverage of central intervals with its standard
error: ``coverage`` and ``coverage_se`` (level,) of the state. Packages add measures of their own (:data:`EXTENSIONS`).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.arrays import Booleans
from poseppl.diagnostics.calibration import LEVELS, between, coverage, inside_interval, probability_transform
from poseppl.diagnostics.inefficiency import autocorrelation, mixing
from poseppl.runs.contents import check_one_series, draws_of, flat_draws, group_of, nearest_turn, variable
from poseppl.runs.results import is_weighted

MAX_LAG = 50
_BLOCK_BYTES = 2**26
_GRID = ("frame", "state_dim")


def diagnose(tree: xr.DataTree, *, max_lag: int = MAX_LAG) -> xr.DataTree:
    """Add the group ``diagnostics`` to a result.

    Args:
        tree: The result; not changed.
        max_lag: Largest lag of the autocorrelation.

    Returns:
        The result with the group (a shallow copy), computed again if it was there.

    Raises:
        ValueError: The result is one of many series.
    """
    check_one_series(tree)
    posterior = tree["posterior"].dataset
    data: dict[str, Any] = _weighted(tree) if is_weighted(tree) else _chains(flat_draws(tree), max_lag)
    stats = group_of(tree, "sample_stats")
    if "acceptance_rate" in stats and np.isfinite(stats["acceptance_rate"]).any():
        data["rejection_rate"] = (("frame",), 1 - stats["acceptance_rate"].values)
    data |= _against_truth(tree)
    extension = extension_of(tree, "measures")
    data |= {} if extension is None else extension.measure(tree)
    used = {dim for dims, _ in data.values() for dim in dims}
    known: Any = {**posterior.coords, **flat_draws(tree).coords, "level": LEVELS}
    coords = {name: np.asarray(values) for name, values in known.items() if name in used}
    result = tree.copy()
    result["diagnostics"] = xr.DataTree(xr.Dataset(data, coords=coords))
    return result


def diagnosed(tree: xr.DataTree) -> xr.DataTree:
    """The result itself if it has the group ``diagnostics``, else with it."""
    return tree if "diagnostics" in tree.children else diagnose(tree)


def _chains(state: xr.DataArray, max_lag: int) -> dict[str, Any]:
    """Measures of mixing, in blocks of frames so that the transforms stay small."""
    draws: NDArray[Any] = state.values
    chains, length, frames, dofs = draws.shape
    step = max(1, _BLOCK_BYTES // max(1, 32 * chains * length * dofs))
    parts = [mixing(draws[:, :, start : start + step]) for start in range(0, frames, step)]
    lags = [autocorrelation(draws[:, :, start : start + step], max_lag) for start in range(0, frames, step)]
    data: dict[str, Any] = {name: (_GRID, np.concatenate([getattr(part, name) for part in parts])) for name in parts[0]._fields}
    return data | {"autocorrelation": (("lag", *_GRID), np.concatenate(lags, axis=1).astype(np.float32))}


def _weighted(tree: xr.DataTree) -> dict[str, Any]:
    summary = tree["summary"].dataset
    spread = np.asarray(summary["state_sd"].values, np.float64)
    effective = np.asarray(tree["sample_stats"].dataset["ess"].values, np.float64)
    effective = np.where(effective > 0, effective, np.nan)[:, None] * np.ones(spread.shape[1])
    return {
        "tau": (_GRID, int(tree.attrs["num_particles"]) / effective),
        "ess": (_GRID, effective),
        "mcse": (_GRID, spread / np.sqrt(effective)),
    }


def _against_truth(tree: xr.DataTree) -> dict[str, Any]:
    draws, true = draws_of(tree, "state"), variable(tree, "truth", "state")
    if draws is None or true is None:
        return {}
    inside, shares = coverage_of_site(tree, "state")
    about = tree["summary"].dataset["state_mean"].values  # angles are compared in one turn
    near = (nearest_turn(tree, values, about) for values in (draws, true))
    ranks = probability_transform(*near)
    return shares | {"inside": (("level", *_GRID), inside), "probability_transform": (_GRID, ranks)}


def coverage_of_site(tree: xr.DataTree, site: str) -> tuple[Booleans, dict[str, Any]]:
    """Which true values of the flat state or an extra lie in central intervals, and their shares by level.

    Args:
        tree: A result with the truth of it.
        site: Its name.

    Returns:
        (level, frame, ...), and the variables ``coverage`` and ``coverage_se`` of the state, or those with ``_site`` after
        ``coverage``.
    """
    draws, true = draws_of(tree, site), variable(tree, "truth", site)
    assert draws is not None and true is not None
    inside = np.stack([_inside(tree, site, draws, true, level) for level in LEVELS])
    valid = (draws.max(axis=(0, 1)) > draws.min(axis=(0, 1))) & np.isfinite(true)  # a clamped coordinate has no interval
    found = [coverage(part, level, valid=valid)[1:3] for part, level in zip(inside, LEVELS, strict=True)]
    name = "coverage" if site == "state" else f"coverage_{site}"
    columns = zip((name, f"{name}_se"), np.array(found).T, strict=True)
    return inside, {key: (("level",), column) for key, column in columns}


def _inside(tree: xr.DataTree, site: str, draws: NDArray[Any], truth: NDArray[Any], level: float) -> Booleans:
    """From the quantiles over all draws or particles where the summary has them, else from the stored draws."""
    summary = tree["summary"].dataset
    ends = ((1 - level) / 2, (1 + level) / 2)
    levels = summary["quantile"].values if f"{site}_quantile" in summary else np.array([])
    near = [np.flatnonzero(np.isclose(levels, end)) for end in ends]
    if all(len(index) for index in near):
        lower, upper = (summary[f"{site}_quantile"].isel(quantile=int(index[0])).values for index in near)
        if site == "state":
            truth = nearest_turn(tree, truth, (lower + upper) / 2)
        return between(lower, upper, truth)
    return inside_interval(draws, truth, level)


EXTENSIONS = {"body": "poseppl.motion"}
"""Packages by the group of their results; a file can choose none but these."""


def extension_of(tree: xr.DataTree, part: Literal["measures", "verdicts", "report"]) -> Any:
    """A module of the package for a result of this kind; None where there is none.

    Args:
        tree: The result.
        part: The module: ``measures`` has ``measure(tree)``, more of the group ``diagnostics``; ``verdicts`` has ``CHECKS``;
            ``report`` has ``extension(tree)`` and ``draw_track(upper, lower, tree)``.
    """
    names = [name for group, name in EXTENSIONS.items() if group in tree.children]
    return import_module(f"{names[0]}.{part}") if names else None
