r"""The figures of one run for a report and for a comparison, over frames and degrees of freedom, NaN where a run has none.

* ``tau``, ``tau_se`` (frame, state_dim): Inefficiency factor and its standard error: for chains draws / ESS as ArviZ has it,
  from the draws in the result; for weighted particles their number over the effective number of their weights (Choo and Fleet
  2001, Eq. 6), the same for every degree of freedom and without an error.
* ``ess``: Draws, or particles, over tau. The ESS of weights cannot see that particles share an ancestor.
* ``ess_per_second``: ESS over the seconds of a frame: those of all frames, without compilation, over their number. A smoother's
  seconds are its own, without those of its filter.
* ``ess_per_gradient``, ``ess_per_evaluation``: ESS over the gradients of the likelihood at the frame, and over evaluations of
  both the likelihood and its gradient.
* ``rhat``: Split R-hat, where there are two chains or more.
* ``autocorrelation`` (lag, state_dim): Autocorrelation of the chains, mean over the frames.
* ``rejection`` (frame,): 1 - acceptance rate of the chains' moves.
* ``evaluations`` (frame,): Evaluations of the likelihood and of its gradient.
* ``mean``, ``sd``: Posterior mean and standard deviation, over all draws or particles, in the unit of the coordinate (mm or
  radians).
* ``error``: \|mean - truth\|, in the unit of the coordinate; ``error_over_sd`` is the same over the posterior SD.
* ``inside`` (level, ...): 1 where the truth lies in the central interval, 0 where not; NaN for clamped coordinates.
* ``joint_error`` (frame,): Distance of the mean markers from the truth, averaged over the markers, mm.
  ``joint_error_relative`` is the same after the root marker is moved onto its truth.

Methods that approximate the posterior by a formula and draw from that have no Monte Carlo error in their means, and no tau, ESS
or R-hat; they say so themselves (``closed_form`` of a filter or smoother), and their results after them.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.calibration import LEVELS
from poseppl.diagnostics.diagnosis import MAX_LAG, diagnosed
from poseppl.runs.contents import flat_draws, group_of, names_of, nearest_turn, variable
from poseppl.runs.results import is_weighted, provenance

CHAINS, WEIGHTED, FORMULA = "chains", "weighted particles", "closed form"
_FROM_SEED = ("seed", "smoother seed")


def figures_of_run(tree: xr.DataTree) -> xr.Dataset:
    """Compute the figures of a run.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.

    Returns:
        The figures above, and of the run as a whole: ``method``, ``setting`` and ``seed`` (words; runs of one setting and of
        different seeds are replicates of each other), ``kind`` ("chains", "weighted particles" or "closed form"), ``draws``,
        ``seconds`` (a frame), and ``cpu_seconds`` (a frame; of the processor, all threads together).
    """
    whole = diagnosed(tree)
    known, kind = provenance(whole), kind_of_run(whole)
    seconds = _seconds(known, whole["posterior"].sizes["frame"])
    data = _mixing(whole, kind, seconds) | _accuracy(whole) | described(known)
    spent = _seconds(known, whole["posterior"].sizes["frame"], "cpu_seconds")
    data |= {"kind": kind, "draws": _draws(whole), "seconds": seconds, "cpu_seconds": spent}
    return xr.Dataset(data).assign_coords(state_dim=names_of(whole, "state_dim"), level=list(LEVELS))


def kind_of_run(tree: xr.DataTree) -> str:
    """Kind of a result's draws: "chains", "weighted particles", or of a "closed form".

    A result that does not say so itself is of a closed form if its filter took one evaluation of the likelihood a frame.
    """
    if provenance(tree).get("closed form"):
        return FORMULA
    if not is_weighted(tree):
        return CHAINS
    count = variable(tree, "sample_stats", "num_likelihood")
    return FORMULA if count is not None and (count == 1).all() else WEIGHTED


def is_sampled(tree: xr.DataTree) -> bool:
    """Whether a result's means have Monte Carlo error, which inefficiency factors and effective numbers describe."""
    return kind_of_run(tree) != FORMULA


def described(known: dict[str, Any]) -> dict[str, str]:
    """Method, setting and seed of a run, from its provenance: empty if it is unknown."""
    method = str(known.get("smoother") or known.get("filter") or "")
    names = ("model", "filter", "settings", "silhouettes", "smoother", "smoother settings")
    setting = {name: known[name] for name in names if known.get(name) is not None}
    seeds = [str(known[name]) for name in _FROM_SEED if name in known]
    return {"method": method, "setting": json.dumps(setting, sort_keys=True), "seed": "/".join(seeds)}


def _draws(tree: xr.DataTree) -> int:
    sizes = tree["posterior"].sizes
    return int(tree.attrs["num_particles"]) if is_weighted(tree) else int(sizes["chain"] * sizes["draw"])


def _seconds(known: dict[str, Any], frames: int, name: str = "wall_seconds") -> float:
    """Seconds a frame, without compilation; those of the frames that were run, where a run was resumed."""
    wall, count = known.get(name), known.get("frames_run", frames)
    known_time = isinstance(wall, int | float) and isinstance(count, int | float) and wall > 0 and count > 0
    return float(wall) / float(count) if known_time else float("nan")  # type: ignore[arg-type]


def _nothing(tree: xr.DataTree, *dims: str) -> xr.DataArray:
    """NaN over some dimensions, in place of a figure that a result does not have."""
    state = flat_draws(tree)
    return xr.DataArray(np.nan, {dim: state[dim] for dim in dims}, dims)


def _mixing(tree: xr.DataTree, kind: str, seconds: float) -> dict[str, Any]:
    found, stats = tree["diagnostics"].dataset, group_of(tree, "sample_stats")
    nothing, of_frames = _nothing(tree, "frame", "state_dim"), _nothing(tree, "frame")
    names = ("tau", "tau_se", "ess", "rhat")
    data: dict[str, Any] = {name: nothing if kind == FORMULA else found.get(name, nothing) for name in names}
    likelihoods, gradients = (stats.get(name, xr.zeros_like(of_frames)) for name in ("num_likelihood", "num_gradient"))
    evaluations = likelihoods + gradients
    units = {"second": seconds, "gradient": gradients.where(gradients > 0), "evaluation": evaluations.where(evaluations > 0)}
    data |= {f"ess_per_{unit}": data["ess"] / each for unit, each in units.items()}
    rho = found.get("autocorrelation", _nothing(tree, "frame", "state_dim").expand_dims(lag=[0])).mean("frame")
    return data | {
        "autocorrelation": rho.assign_coords(lag=np.arange(len(rho))).reindex(lag=np.arange(MAX_LAG + 1)),
        "rejection": found.get("rejection_rate", of_frames) if kind == CHAINS else of_frames,
        "evaluations": units["evaluation"],
    }


def _accuracy(tree: xr.DataTree) -> dict[str, Any]:
    summary, found, truth = (group_of(tree, name) for name in ("summary", "diagnostics", "truth"))
    nothing, of_frames = _nothing(tree, "frame", "state_dim"), _nothing(tree, "frame")
    mean, spread = (summary[f"state_{name}"].astype(float) for name in ("mean", "sd"))
    true = truth.get("state", nothing)
    error = abs(mean - true.copy(data=nearest_turn(tree, true.values, mean.values)))
    free = (spread > 0).any("frame") & np.isfinite(error)
    inside = found.get("inside", nothing.expand_dims(level=len(LEVELS)))
    of_joints = {
        name: found[name].mean("marker").astype(float) if name in found else of_frames
        for name in ("joint_error", "joint_error_relative")
    }
    return of_joints | {
        "mean": mean,
        "sd": spread,
        "error": error.where(free),
        "error_over_sd": error / spread.where(spread > 0),
        "inside": inside.astype(float).where(free),
    }
