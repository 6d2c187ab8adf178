r"""Limbs that a detector exchanges for many frames, by how they move in the pictures of one camera.

A left and a right limb that change positions from one frame to the next were exchanged. In each camera, steps of the points
from frame to frame are Student-t, with the same limbs or across. The exchanges are the Markov chain of
:mod:`poseppl.motion.points.swaps`, whose most probable sequence Viterbi's algorithm finds. Limbs that cross in a picture look
like an exchange. So the sequence is only a proposal for each pair of limbs. It is accepted if the points of several cameras
then fit and move better: steps of positions, and distances of points from their projections, are Student-t as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.geometry.recorded_frames import image_points
from poseppl.motion.keypoints.camera_errors import camera_errors
from poseppl.motion.points.swaps import LASTS, SHARE, Pair, exchanged

LIMBS = {"arms": ("shoulder", "elbow", "wrist"), "legs": ("hip", "knee", "ankle", "heel", "big_toe", "small_toe")}
"""Markers of the limbs that a detector may exchange, without their sides."""
_FREEDOM = 4.0
_SMALLEST = 1.0
"""Scale of steps, px or mm, at least."""


def limb_pairs(markers: Sequence[str]) -> dict[str, Pair]:
    """Indices of the left and the right markers of each pair of limbs that a body has."""
    found = {}
    for name, parts in LIMBS.items():
        both = [part for part in parts if {f"{part}_l", f"{part}_r"} <= set(markers)]
        if both:
            left, right = (tuple(markers.index(f"{part}_{side}") for part in both) for side in "lr")
            found[name] = (left, right)
    return found


def proposed_swaps(cameras: Cameras, points: Floats, confidence: Floats, pairs: Sequence[Pair], rate: float) -> Floats:
    """Which limbs to take for exchanged at first (T, C, P): 1 or 0.

    Args:
        cameras: C cameras.
        points: (T, C, K, 2) px, NaN where not seen.
        confidence: (T, C, K).
        pairs: P pairs of limbs.
        rate: Frames a second.
    """
    swaps = np.zeros((*points.shape[:2], len(pairs)))
    noise = camera_errors(cameras, points, triangulate(cameras, points, confidence)).scale
    noise = np.where(np.isfinite(noise), noise, np.nanmax(noise) if np.isfinite(noise).any() else _SMALLEST)
    for number, pair in enumerate(pairs):
        own = np.zeros_like(swaps)
        for camera in range(points.shape[1]):
            own[:, camera, number] = _crossings(points[:, camera], pair, rate)
        if own.any():
            plain, corrected = (_fit(cameras, exchanged(points, each, pairs), confidence, noise, pair) for each in (swaps, own))
            swaps = own + swaps if corrected > plain else swaps
    return swaps


def _crossings(points: Floats, pair: Pair, rate: float) -> Floats:
    """The likeliest sequence (T,) of exchanges in one camera, by points (T, K, 2)."""
    left, right = (points[:, list(limb)] for limb in pair)
    now = np.stack([left, right])
    last, steps = now[:, 0].copy(), []
    for t in range(1, len(points)):
        steps.append([now[:, t] - last, now[::-1, t] - last])
        last = np.where(np.isfinite(now[:, t]), now[:, t], last)
    size = np.linalg.norm(np.array(steps), axis=-1)  # (T - 1, same or across, side, part)
    size = size.reshape(*size.shape[:2], -1)
    both = np.isfinite(size).all(1)
    if not both.any():
        return np.zeros(len(points))
    scale = max(_SMALLEST, float(np.median(size.min(1)[both])))
    gain = np.where(both[:, None], _log_student(size / scale, 2), 0.0).sum(-1)
    kept = np.exp(-1 / rate / LASTS)
    moves = np.log([[1 - SHARE * (1 - kept), SHARE * (1 - kept)], [(1 - SHARE) * (1 - kept), SHARE + (1 - SHARE) * kept]])
    best, back = np.log([1 - SHARE, SHARE]), []
    for same, across in gain:
        score = best[:, None] + moves + np.array([[same, across], [across, same]])
        back.append(score.argmax(0))
        best = score.max(0)
    states = [int(best.argmax())]
    for origin in reversed(back):
        states.append(int(origin[states[-1]]))
    return np.array(states[::-1], float)


def _fit(cameras: Cameras, points: Floats, confidence: Floats, noise: Floats, pair: Pair) -> float:
    """How well a pair's points (T, C, K, 2) meet, and their places follow each other."""
    of = [*pair[0], *pair[1]]
    own = points[:, :, of]
    places = triangulate(cameras, own, confidence[:, :, of])
    seen = np.moveaxis(image_points(cameras, np.nan_to_num(places)), 0, 1)
    missed = np.linalg.norm(own - seen, axis=-1) / noise[:, None]
    step = np.linalg.norm(np.diff(places, axis=0), axis=-1)
    step /= max(_SMALLEST, float(np.nanmedian(step)) if np.isfinite(step).any() else _SMALLEST)
    return float(np.nansum(_log_student(missed, 2)) + np.nansum(_log_student(step, 3)))


def _log_student(size: Floats, dimension: int) -> Floats:
    return np.asarray(-(_FREEDOM + dimension) / 2 * np.log1p(size**2 / _FREEDOM))
