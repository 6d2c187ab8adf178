"""Constant offsets between cameras' clocks, from what they see of one person who moves.

Rays of one point in two cameras pass each other at a signed distance. If one camera is late, it changes as the point moves; an
error of the calibration changes it little in time. So points that leap are left out, each point's mean is taken away, and the
shift between the two cameras is sought that makes the rest small, by Gauss and Newton under Student-t errors (4 degrees of
freedom), with points interpolated between frames. Its variance is the sandwich's, all errors of an eighth of the time or of one
keypoint taken for one, whichever is larger (Liang and Zeger 1986, doi:10.1093/biomet/73.1.13), and that of :data:`SYSTEMATIC`.
The cameras' offsets are the least squares of the shifts of all pairs. Where to begin is found at whole frames: the shift at
which the detections of two cameras pass nearest, whoever they are of.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.triangulation import viewing_rays
from poseppl.motion.io import DetectedPeople
from poseppl.motion.tracking.leaps import without_leaps

LARGEST_SHIFT = 60
"""Frames; larger offsets have to be given."""
_MOST_FRAMES = 400
_LEAST_FRAMES, _LEAST_POINTS = 20, 4
_CONFIDENT, _LEAST = 0.3, 0.1
"""Points of less confidence do not tell an offset, in whole frames and between them, where they count by their confidence."""
_FREEDOM = 4.0
_STEP = 0.5
"""Frames, of the differences that derivatives are made of."""
_ROUNDS = 10
_LEAST_LEAP = 50.0
"""How far a point is that leaps, px: averaged over five frames it would move all of them."""
_BINOMIAL = (1.0, 4.0, 6.0, 4.0, 1.0)
SYSTEMATIC = 0.003
"""Seconds: standard deviation of what errors of calibration make of a pair's shift, as in the recording of four synchronised
cameras that `tests/motion/tracking/test_clock_offsets.py` reads."""


class Offsets(NamedTuple):
    """Frames by which cameras are late.

    Attributes:
        frames: (C,), the first camera's 0.
        deviation: (C,) standard deviations.
    """

    frames: Floats
    deviation: Floats


def coarse_offsets(cameras: Cameras, people: Sequence[DetectedPeople]) -> Floats:
    """Whole frames (C,) by which cameras are late, the first camera's 0.

    Args:
        cameras: C cameras.
        people: What each saw, in common frames.
    """
    count = len(people)
    rays = [viewing_rays(cameras, c, _confident(found.points, found.confidence)) for c, found in enumerate(people)]
    found: dict[tuple[int, int], tuple[float, int]] = {}
    for a, b in combinations(range(count), 2):
        costs = _shift_costs(cameras, a, rays[a], b, rays[b])
        if costs:
            shift = min(costs, key=costs.__getitem__)
            found[a, b] = (costs[shift] / max(float(np.median(list(costs.values()))), 1e-9), shift)
    # the pairs whose best shift stands out most are joined first
    groups = [{c: 0.0} for c in range(count)]
    for (a, b), (_, shift) in sorted(found.items(), key=lambda item: item[1][0]):
        first, second = (next(group for group in groups if camera in group) for camera in (a, b))
        if first is not second:
            moved = first[a] + shift - second[b]
            first.update({camera: value + moved for camera, value in second.items()})
            groups.remove(second)
    late = next(group for group in groups if 0 in group)
    return np.array([late.get(c, 0.0) - late[0] for c in range(count)])


def fine_offsets(cameras: Cameras, points: Floats, confidence: Floats, rate: float) -> Offsets | None:
    """Offsets of less than a few frames, with their standard deviations.

    Args:
        cameras: C cameras.
        points: (T, C, K, 2) of one person, NaN where not seen.
        confidence: (T, C, K).
        rate: Frames a second.

    Returns:
        The offsets; None where too little is seen to tell one of them.
    """
    seen, count = _smooth(without_leaps(_confident(points, confidence, _LEAST), _LEAST_LEAP)), points.shape[1]
    rows: list[Floats] = []
    shifts: list[float] = []
    weights: list[float] = []
    for a, b in combinations(range(count), 2):
        found = _pair_shift(cameras, seen, a, b, np.clip(confidence[:, a] * confidence[:, b], 0.0, 1.0))
        if found is not None:
            rows.append(np.eye(count)[b] - np.eye(count)[a])
            shifts.append(found[0])
            weights.append(1 / (found[1] ** 2 + (SYSTEMATIC * rate) ** 2))
    design = np.array(rows).reshape(-1, count)[:, 1:]
    if np.linalg.matrix_rank(design) < count - 1:
        return None
    covariance = np.linalg.inv(design.T @ (np.array(weights)[:, None] * design))
    late = covariance @ (design.T @ (np.array(weights) * shifts))
    return Offsets(np.append(0.0, late), np.append(0.0, np.sqrt(np.diag(covariance))))


def _pair_shift(cameras: Cameras, points: Floats, a: int, b: int, trust: Floats) -> tuple[float, float] | None:
    """Frames by which camera b is later than a, and their standard deviation; None where too little is seen.

    Points (T, K) count by their ``trust``.
    """
    rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MOST_FRAMES)).astype(int))
    shift = 0.0
    for _ in range(_ROUNDS):
        gap = _gaps(cameras, points, rows, a, b, shift)
        sides = [_gaps(cameras, points, rows, a, b, shift + step) for step in (_STEP, -_STEP)]
        slope = (sides[0] - sides[1]) / (2 * _STEP)
        known = np.isfinite(gap) & np.isfinite(slope)
        if known.sum() < _LEAST_FRAMES * _LEAST_POINTS:
            return None
        scale = max(1.4826 * float(np.median(np.abs(gap[known]))), 1e-6)
        weight = np.where(known, trust[rows] / (1 + (np.where(known, gap, 0.0) / scale) ** 2 / _FREEDOM), 0.0)
        slope, gap = np.where(known, slope, 0.0), np.where(known, gap, 0.0)
        curvature = float((weight * slope**2).sum())
        if curvature <= 0:
            return None
        step = -float((weight * slope * gap).sum()) / curvature
        shift += float(np.clip(step, -2.0, 2.0))
        if abs(step) < 1e-2:
            break
    scores = weight * slope * gap
    blocks = np.add.reduceat(scores, np.arange(0, len(scores), max(1, len(scores) // 8)), axis=0).sum(1)
    return shift, max(_sandwich(curvature, scores.sum(0)), _sandwich(curvature, blocks))


def _sandwich(curvature: float, scores: Floats) -> float:
    """Standard deviation from the sums of scores of what errs alike."""
    used = max(int((scores != 0).sum()), 2)
    return float(np.sqrt((scores**2).sum() * used / (used - 1)) / curvature)


def _confident(points: Floats, confidence: Floats, least: float = _CONFIDENT) -> Floats:
    return np.where((confidence >= least)[..., None], points, np.nan)


def _smooth(points: Floats) -> Floats:
    """Points (T, ...) averaged over five frames, of all cameras alike.

    Without it, interpolation between two frames would average errors that points on a frame have in full, and shifts of half a
    frame seem better than they are.
    """
    total = np.zeros_like(points)
    weights = np.zeros_like(points)
    for step, weight in zip(range(-2, 3), _BINOMIAL, strict=True):
        into = slice(max(0, step), len(points) + min(0, step))
        of = slice(max(0, -step), len(points) + min(0, -step))
        known = np.isfinite(points[of])
        total[into] += np.where(known, weight * points[of], 0.0)
        weights[into] += weight * known
    return np.where(np.isfinite(points) & (weights == sum(_BINOMIAL)), total / sum(_BINOMIAL), np.nan)


def _shift_costs(cameras: Cameras, a: int, first: Floats, b: int, second: Floats) -> dict[int, float]:
    """Median distance (mm) by which the nearest detections of two cameras pass each other, by the second one's shift."""
    centres = np.asarray(cameras.centre, np.float64)
    total, costs = len(first), {}
    for shift in range(-LARGEST_SHIFT, LARGEST_SHIFT + 1):
        rows = np.arange(max(0, -shift), min(total, total - shift))
        if len(rows) < max(_LEAST_FRAMES, total // 4):
            continue
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MOST_FRAMES // 2)).astype(int))]
        apart = np.abs(_distance(centres[a], first[rows][:, :, None], centres[b], second[rows + shift][:, None]))
        common = np.isfinite(apart).sum(-1) >= _LEAST_POINTS
        near = np.where(common, _median(apart), np.inf).reshape(len(rows), -1).min(1)
        if np.isfinite(near).sum() >= _LEAST_FRAMES:
            costs[shift] = float(np.median(near[np.isfinite(near)]))
    return costs


def _median(values: Floats) -> Floats:
    """Median of the last axis, of what is known in it."""
    ordered = np.sort(values, -1)
    middle = np.maximum((np.isfinite(values).sum(-1, keepdims=True) - 1) // 2, 0)
    return np.asarray(np.take_along_axis(ordered, middle, -1)[..., 0])


def _distance(first: Floats, first_rays: Floats, second: Floats, second_rays: Floats) -> Floats:
    """Signed shortest distances (mm) between lines."""
    normal = np.cross(first_rays, second_rays)
    return np.asarray(normal @ (second - first) / np.maximum(np.linalg.norm(normal, axis=-1), 1e-9))


def _gaps(cameras: Cameras, points: Floats, rows: Integers, a: int, b: int, shift: float) -> Floats:
    """Signed distances (N, K) of the rays of two cameras, each half of the shift away, without the mean of each point."""
    centres = np.asarray(cameras.centre, np.float64)
    first = viewing_rays(cameras, a, _at(points[:, a], np.asarray(rows - shift / 2, np.float64)))
    second = viewing_rays(cameras, b, _at(points[:, b], np.asarray(rows + shift / 2, np.float64)))
    gaps = _distance(centres[a], first, centres[b], second)
    known = np.isfinite(gaps)
    values, weights = np.where(known, gaps, 0.0), known.astype(float)
    middle = np.zeros(values.shape[1:])
    for _ in range(5):
        middle = (weights * values).sum(0) / np.maximum(weights.sum(0), 1e-9)
        scale = np.sqrt((weights * (values - middle) ** 2).sum(0) / np.maximum(weights.sum(0), 1e-9)) + 1e-6
        weights = known / (1 + ((values - middle) / scale) ** 2 / _FREEDOM)
    return np.where(known & (known.sum(0) >= _LEAST_FRAMES), gaps - middle, np.nan)


def _at(points: Floats, positions: Floats) -> Floats:
    """Points (T, K, 2) interpolated at places between frames; NaN outside, and where a neighbour is not seen."""
    last = len(points) - 1
    before = np.clip(np.floor(positions).astype(int), 0, max(last - 1, 0))
    part = (positions - before)[:, None, None]
    found = (1 - part) * points[before] + part * points[np.minimum(before + 1, last)]
    whole = np.abs(part) < 1e-9
    found = np.where(whole, points[before], found)
    return np.asarray(np.where(((positions >= 0) & (positions <= last))[:, None, None], found, np.nan))
