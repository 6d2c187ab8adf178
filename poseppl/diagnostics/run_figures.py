r"""The figures of one run for a comparison, each over frames and degrees of freedom, NaN where a run has none.

=========================  ==============================================================================================
``tau`` (frame, dof)       Inefficiency factor: for chains draws / ESS as ArviZ has it, from the draws that the result
                           holds; for weighted particles their number over the effective number of their weights (Choo
                           and Fleet 2001, Eq. 6), the same for every degree of freedom.
``ess``                    Draws, or particles, over tau. The ESS of weights cannot see that particles share an ancestor.
``ess_per_second``         ESS over the seconds of a frame: those of all frames, without compilation, over their number. A
                           smoother's seconds are its own, without those of its filter.
``ess_per_evaluation``     ESS over the evaluations of the likelihood and of its gradient at the frame.
``rhat``                   Split R-hat, where there are two chains or more.
``rejection`` (frame,)     1 - acceptance rate of the chains' moves.
``evaluations`` (frame,)   Evaluations of the likelihood and of its gradient.
``mean``, ``sd``           Of the posterior, over all draws or particles, in the unit of the coordinate (mm or radians).
``error``                  \|mean - truth\|, in the unit of the coordinate.
``error_over_sd``          The same over the posterior standard deviation.
``inside`` (level, ...)    1 where the truth lies in the central interval, 0 where not; NaN for clamped coordinates.
``joint_error`` (frame,)   Distance of the mean markers from the truth, averaged over the markers, mm.
``joint_error_relative``   The same after the root marker is moved onto its truth.
=========================  ==============================================================================================

Methods that approximate the posterior by a formula and draw from that have no Monte Carlo error in their means, and no tau, ESS
or R-hat; they say so themselves (``closed_form`` of a filter or smoother), and their results after them.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.diagnostics.autocorrelation import Floats
from poseppl.diagnostics.calibration import LEVELS
from poseppl.diagnostics.diagnosis import diagnose
from poseppl.runs.results import is_weighted, provenance

CHAINS, WEIGHTED, FORMULA = "chains", "weighted particles", "closed form"
_GRID = ("frame", "dof")
_FROM_SEED = ("seed", "smoother seed")


def figures_of_run(tree: xr.DataTree) -> xr.Dataset:
    """Compute the figures of a run.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.

    Returns:
        The figures above, and of the run as a whole: ``method``, ``setting`` and ``seed`` (words; runs of one setting and of
        different seeds are replicates of each other), ``kind`` ("chains", "weighted particles" or "closed form"), ``draws``
        and ``seconds`` (a frame).
    """
    whole = tree if "diagnostics" in tree.children else diagnose(tree)
    posterior, known = whole["posterior"].dataset, provenance(whole)
    kind = kind_of_run(whole)
    seconds = _seconds(known, posterior.sizes["frame"])
    data = _mixing(whole, kind, seconds) | _accuracy(whole)
    data |= {name: ((), value) for name, value in described(known).items()}
    data |= {"kind": ((), kind), "draws": ((), _draws(whole)), "seconds": ((), seconds)}
    coords = {"frame": posterior["frame"].values, "dof": posterior["dof"].values.astype(str), "level": np.array(LEVELS)}
    return xr.Dataset(data, coords=coords)


def kind_of_run(tree: xr.DataTree) -> str:
    """Kind of a result's draws: "chains", "weighted particles", or of a "closed form".

    A result that does not say so itself is of a closed form if its filter took one evaluation of the likelihood a frame.
    """
    if provenance(tree).get("closed form"):
        return FORMULA
    if not is_weighted(tree):
        return CHAINS
    count = _statistic(tree, "num_likelihood")
    return FORMULA if count is not None and (count == 1).all() else WEIGHTED


def described(known: dict[str, Any]) -> dict[str, str]:
    """Method, setting and seed of a run, from its provenance: empty words where it does not tell."""
    method = str(known.get("smoother") or known.get("filter") or "")
    names = ("model", "filter", "settings", "silhouettes", "smoother", "smoother settings")
    setting = {name: known[name] for name in names if known.get(name) is not None}
    seeds = [str(known[name]) for name in _FROM_SEED if name in known]
    return {"method": method, "setting": json.dumps(setting, sort_keys=True), "seed": "/".join(seeds)}


def _draws(tree: xr.DataTree) -> int:
    sizes = tree["posterior"].sizes
    return int(tree.attrs["num_particles"]) if is_weighted(tree) else int(sizes["chain"] * sizes["draw"])


def _seconds(known: dict[str, Any], frames: int) -> float:
    """Seconds a frame, without compilation; those of the frames that were run, where a run was resumed."""
    wall, count = known.get("wall_seconds"), known.get("frames_run", frames)
    known_time = isinstance(wall, int | float) and isinstance(count, int | float) and wall > 0 and count > 0
    return float(wall) / float(count) if known_time else float("nan")  # type: ignore[arg-type]


def _statistic(tree: xr.DataTree, name: str) -> Floats | None:
    if "sample_stats" not in tree.children or name not in tree["sample_stats"].dataset:
        return None
    return np.asarray(tree["sample_stats"].dataset[name].values, np.float64)


def _evaluations(tree: xr.DataTree, frames: int) -> Floats:
    counts = [found for name in ("num_likelihood", "num_gradient") if (found := _statistic(tree, name)) is not None]
    total = np.sum(counts, axis=0) if counts else np.zeros(frames)
    return np.where(total > 0, total, np.nan)


def _mixing(tree: xr.DataTree, kind: str, seconds: float) -> dict[str, Any]:
    sizes, found = tree["posterior"].sizes, tree["diagnostics"].dataset
    shape = (sizes["frame"], sizes["dof"])

    def known(name: str, shape: tuple[int, ...] = shape) -> Floats:
        missing = kind == FORMULA or name not in found
        return np.full(shape, np.nan) if missing else np.asarray(found[name].values, np.float64)

    ess, evaluations = known("ess"), _evaluations(tree, shape[0])
    return {
        "tau": (_GRID, known("tau")),
        "ess": (_GRID, ess),
        "ess_per_second": (_GRID, ess / seconds),
        "ess_per_evaluation": (_GRID, ess / evaluations[:, None]),
        "rhat": (_GRID, known("rhat")),
        "rejection": (("frame",), known("rejection_rate", shape[:1]) if kind == CHAINS else np.full(shape[:1], np.nan)),
        "evaluations": (("frame",), evaluations),
    }


def _accuracy(tree: xr.DataTree) -> dict[str, Any]:
    summary, found = tree["summary"].dataset, tree["diagnostics"].dataset
    mean, spread = (np.asarray(summary[f"state_{name}"].values, np.float64) for name in ("mean", "sd"))
    truth = tree["truth"].dataset if "truth" in tree.children else xr.Dataset()
    error = np.abs(mean - truth["state"].values) if "state" in truth else np.full(mean.shape, np.nan)
    free = (spread > 0).any(axis=0) & np.isfinite(error)
    inside = found["inside"].values if "inside" in found else np.zeros((len(LEVELS), *mean.shape))
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(spread > 0, error / spread, np.nan)
    data: dict[str, Any] = {
        "mean": (_GRID, mean),
        "sd": (_GRID, spread),
        "error": (_GRID, np.where(free, error, np.nan)),
        "error_over_sd": (_GRID, scaled),
        "inside": (("level", *_GRID), np.where(free, inside.astype(float), np.nan)),
    }
    for name in ("joint_error", "joint_error_relative"):
        values: NDArray[Any] | None = found[name].values if name in found else None
        data[name] = (("frame",), np.full(len(mean), np.nan) if values is None else values.mean(axis=1).astype(float))
    return data
