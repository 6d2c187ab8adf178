"""The numbers that sum a run up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.run_figures import is_sampled


class Metrics(NamedTuple):
    """Numbers of a run, each None where it does not apply.

    Attributes:
        joint_error: Mean distance of the markers from the truth, mm.
        joint_error_relative: The same after the root marker is moved onto its truth, mm.
        coverage: Share of the true joint coordinates inside of their central 90 % intervals.
        coverage_state: The same of the state's coordinates.
        rejection: Mean rejection rate of the moves.
        tau: Median inefficiency factor over frames and coordinates.
        tau_mean: Its mean, which a few frames that mix badly decide.
        failed: How many frames' data were impossible.
        frames_per_second: Frames a second, without compilation.
    """

    joint_error: float | None
    joint_error_relative: float | None
    coverage: float | None
    coverage_state: float | None
    rejection: float | None
    tau: float | None
    tau_mean: float | None
    failed: int
    frames_per_second: float | None


def measure_run(tree: xr.DataTree) -> Metrics:
    """Sum a result up.

    Args:
        tree: A result with the group ``diagnostics``.
    """
    diagnostics = tree["diagnostics"].dataset
    frames = tree["posterior"].sizes["frame"]
    seconds = float(tree.attrs.get("wall_seconds", "nan"))
    done = float(tree.attrs.get("frames_run", frames))

    def mean(name: str) -> float | None:
        return _finite(np.nanmean(diagnostics[name].values)) if name in diagnostics else None

    def at_ninety(name: str) -> float | None:
        if name not in diagnostics:
            return None
        return _finite(diagnostics[name].values[np.argmin(np.abs(diagnostics["level"].values - 0.9))])

    tau = diagnostics["tau"].values if "tau" in diagnostics and is_sampled(tree) else np.array([np.nan])
    return Metrics(
        joint_error=mean("joint_error"),
        joint_error_relative=mean("joint_error_relative"),
        coverage=at_ninety("coverage_markers"),
        coverage_state=at_ninety("coverage"),
        rejection=mean("rejection_rate"),
        tau=None if np.isnan(tau).all() else float(np.nanmedian(tau)),
        tau_mean=None if np.isnan(tau).all() else float(np.nanmean(tau)),
        failed=int(tree["sample_stats"].dataset["failed"].values.sum()),
        frames_per_second=done / seconds if seconds > 0 and done > 0 else None,
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
