r"""Errors as papers on body tracking state them: mean distances of virtual markers, absolute, relative and optimistic.

A set of virtual markers at the joints of a body stands against as many of the person (Balan, Sigal and Black 2005; Sigal and
Black 2006, Eqs. 3 to 6; Darby, Li and Costen 2008, section 7). For one posture the error is the mean distance over the markers,
and the relative error the same after the pelvis is moved onto its truth. For weighted particles there are

    of the mean      the error of the weighted mean of the markers (Peursum, Venkatesh and West 2010, section 5.1),
    weighted         the weighted mean of the particles' errors (Darby, section 7), never below that of the mean,
    optimistic       the least error of any particle of the set, whatever its weight: a lower bound, which the truth chooses.

The fifteen markers are those of :data:`VIRTUAL_MARKERS`. Two of them are midpoints, so that they mean the same on every body:
the pelvis is the middle of the hips, and the neck that of the shoulders. The head is the marker ``crown``.

>>> truth = np.zeros((1, 2, 3))
>>> places = np.array([[[[3.0, 4, 0], [3, 4, 0]], [[0, 0, 0], [0, 12, 0]]]])
>>> found = marker_errors(places, [[1.0, 0.0]], truth)
>>> float(found.absolute.mean()), float(found.relative.mean()), float(found.optimistic[0])
(5.0, 0.0, 5.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseppl.arrays import Floats
from poseppl.motion.measures import joint_error

_LIMBS = tuple(f"{joint}_{side}" for side in "lr" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"))
VIRTUAL_MARKERS = ("pelvis", "neck", "crown", *_LIMBS)
"""Fifteen markers: the middles of hips and shoulders, the end of the head, and both sides' six joints of arm and leg."""


class MarkerErrors(NamedTuple):
    """Errors of T frames and K markers, mm; NaN where the truth is unknown.

    Attributes:
        absolute: Distance of the weighted mean from the truth (T, K).
        relative: The same with the pelvises together (T, K).
        weighted: Weighted mean of the particles' mean distances (T,).
        weighted_relative: The same with the pelvises together (T,).
        optimistic: Least mean distance of any particle (T,).
    """

    absolute: Floats
    relative: Floats
    weighted: Floats
    weighted_relative: Floats
    optimistic: Floats


class OverRuns(NamedTuple):
    """Mean and standard deviation over runs of each run's mean; the deviation is NaN for a single run."""

    mean: float
    sd: float


def virtual_markers(names: Sequence[str], places: ArrayLike) -> NDArray[Any]:
    """Pick the fifteen virtual markers.

    Args:
        names: K names of markers, those of both sides and ``crown`` among them.
        places: (..., K, 3) mm.

    Returns:
        (..., 15, 3) mm, in the order of :data:`VIRTUAL_MARKERS`.

    Raises:
        ValueError: A marker is missing, or the places are not of K markers.
    """
    points, index = np.asarray(places), {name: number for number, name in enumerate(names)}
    if points.shape[-2:] != (len(index), 3):
        raise ValueError(f"places have shape {points.shape}. Expected (..., {len(index)}, 3).")
    missing = [name for name in ("crown", *_LIMBS) if name not in index]
    if missing:
        raise ValueError(f"there is no marker {', '.join(missing)}. Expected crown, {', '.join(_LIMBS)}.")
    pairs = {"pelvis": ("hip_l", "hip_r"), "neck": ("shoulder_l", "shoulder_r")}
    chosen = [pairs.get(name, (name, name)) for name in VIRTUAL_MARKERS]
    first, second = ([index[pair[end]] for pair in chosen] for end in (0, 1))
    middles: NDArray[Any] = (points[..., first, :] + points[..., second, :]) / 2
    return middles


def marker_errors(places: ArrayLike, weights: ArrayLike, truth: ArrayLike, *, root: int = 0) -> MarkerErrors:
    """Measure the errors of weighted particles.

    Args:
        places: Markers of N particles in T frames (T, N, K, 3), mm; a single posture has N = 1.
        weights: Their weights (T, N), which need not add up to 1. The places of a particle of no weight count for the
            optimistic error only.
        truth: (T, K, 3) mm; NaN where unknown.
        root: Index of the marker (the pelvis) that is moved onto the truth for relative errors.

    Raises:
        ValueError: Shapes do not match, or the weights of a frame are negative, not finite, or add up to nothing.
    """
    points, share, true = np.asarray(places), np.asarray(weights, np.float64), np.asarray(truth, np.float64)
    if points.ndim != 4 or points.shape[-1] != 3:
        raise ValueError(f"places have shape {points.shape}. Expected (T, N, K, 3).")
    frames, count, markers, _ = points.shape
    if share.shape != (frames, count) or true.shape != (frames, markers, 3):
        problem = f"weights have shape {share.shape} and the truth {true.shape}"
        raise ValueError(f"{problem}. Expected {(frames, count)} and {(frames, markers, 3)}, as the places {points.shape}.")
    if not (np.all(np.isfinite(share)) and np.all(share >= 0) and np.all(share.sum(1) > 0)):
        raise ValueError("weights are negative, not finite, or add up to nothing in a frame. Expected a distribution.")
    share = share / share.sum(1, keepdims=True)
    mean = joint_error(np.einsum("tn,tnkx->tkx", share, np.where(share[..., None, None] > 0, points, 0.0)), true, root)
    difference = points - true[:, None]
    each = _mean(np.linalg.norm(difference, axis=-1))
    beside = _mean(np.linalg.norm(difference - difference[:, :, root : root + 1], axis=-1))
    weighted, relative = (np.sum(np.where(share > 0, share * error, 0.0), 1) for error in (each, beside))
    best = np.min(np.where(np.isnan(each), np.inf, each), 1)
    return MarkerErrors(mean.absolute, mean.relative, weighted, relative, np.where(np.isfinite(best), best, np.nan))


def over_runs(errors: ArrayLike) -> OverRuns:
    """Mean and standard deviation over R runs of the mean error of each.

    Args:
        errors: (R, ...); what is NaN is left out of a run's mean.

    Raises:
        ValueError: There is no run.
    """
    values = np.asarray(errors, np.float64)
    if values.ndim == 0 or len(values) == 0:
        raise ValueError(f"errors have shape {values.shape}. Expected (R, ...) with R of at least 1.")
    means = _mean(values.reshape(len(values), -1))
    return OverRuns(float(means.mean()), float(means.std(ddof=1)) if len(means) > 1 else float("nan"))


def _mean(values: Floats) -> Floats:
    """Mean over the last axis of what is known; NaN where nothing is."""
    known = np.isfinite(values)
    count = known.sum(-1)
    return np.where(count > 0, np.where(known, values, 0.0).sum(-1) / np.maximum(count, 1), np.nan)
