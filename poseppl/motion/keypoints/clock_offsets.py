"""Constant offsets between cameras' clocks, from what they see of one person who moves.

Rays of one point in two cameras pass each other at a signed distance. If one camera is late, it changes as the point moves; an
error of the calibration changes it little in time. So points that jump are left out, and each point's mean is subtracted.
Newton's method finds the shift between the two cameras that makes the remainder, g, small, under Student-t errors (4 degrees of
freedom). Rays at any time, on a frame or between two, are means over the frames around it, weighted by a Gaussian with a
standard deviation of one frame. Noise then has the same variance at all shifts, so that it favours none. It adds nothing to the
mean of the curvature, sum(w (g'^2 + g g'')), but it would to sum(w g'^2), which would make shifts look more precise than they
are.

The offsets are the least squares of the shifts of all pairs. Their covariance is a sandwich estimate over all pairs together,
because pairs share cameras. It is the sum of two such estimates: one with clusters by keypoint, and one with clusters by
eighths of the time. (Cameron, Gelbach and Miller 2011, doi:10.1198/jbes.2010.07136, subtract the part that both have in
common.) Each score is divided by the curvature without its own cluster (the jackknife's, Bell and McCaffrey 2002, Survey
Methodology 28). The variance of :data:`SYSTEMATIC` is added for each pair.

The search starts at a whole number of frames: the shift at which the detections of two cameras, of any person, pass nearest. In
this search each point's median distance is subtracted, up to 100 mm, for the calibration may be off by so much. Without that, a
walk a stride later may pass nearer than the same frames do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import viewing_rays
from poseppl.motion.io import DetectedPeople
from poseppl.motion.keypoints.leaps import despike

LARGEST_SHIFT = 60
"""Frames; larger offsets have to be given."""
_MAX_FRAMES = 400
_MIN_FRAMES, _MIN_POINTS = 20, 4
_CONFIDENT, _MIN = 0.3, 0.1
"""Points of less confidence do not tell an offset, in whole frames and between them, where they count by their confidence."""
_FREEDOM = 4.0
_STEP = 0.5
"""Frames, of the differences that derivatives are made of."""
_ROUNDS = 10
_MIN_LEAP = 50.0
"""How far a point is that leaps, px: averaged over five frames it would move all of them."""
_AROUND = 2
"""Frames to either side that a mean is over, beside those that the place lies between."""
_MIN_CURVATURE = 0.2
"""In units of sum(w g'^2): where noise alone makes the slopes, nothing is known."""
_CALIBRATION = 100.0
"""Distance (mm) by which errors of the calibration may move rays of a point past each other, in the search of whole frames."""
_PARTS, _LARGEST_SHARE = 8, 0.9
"""Parts of the time whose errors are taken for one; share of the curvature that one group has at most."""
SYSTEMATIC, SECONDS = 0.003, 5 / 3
"""Seconds: standard deviation of what errors of calibration make of a pair's shift, in a recording of so many seconds: that of
four synchronised cameras which `tests/motion/keypoints/test_clock_offsets.py` reads. In shorter parts of it it is the larger
the shorter they are; in longer ones it is taken for no smaller, which nothing tells."""


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
        people: Detections of each camera in common frames.
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


class PairShift(NamedTuple):
    """By how many frames a camera is later than another one, and what tells it.

    Attributes:
        cameras: Indices of the two.
        frames: The shift.
        influences: Changes of it by errors, by keypoint (K,) and by part of the time (G,).
        together: Frames in which both see a point.
    """

    cameras: tuple[int, int]
    frames: float
    influences: tuple[Floats, Floats]
    together: float

    @property
    def variance(self) -> float:
        """Variance of the shift, without errors of the calibration."""
        return float(sum((each**2).sum() for each in self.influences))

    def systematic(self, rate: float) -> float:
        """Variance of what errors of the calibration make of the shift, at so many frames a second."""
        return float((SYSTEMATIC * rate * max(1.0, SECONDS * rate / self.together)) ** 2)


def synchronize(cameras: Cameras, points: Floats, confidence: Floats, rate: float) -> Offsets | None:
    """Offsets of less than a few frames, with their standard deviations.

    Args:
        cameras: C cameras.
        points: (T, C, K, 2) of one person, NaN where not seen.
        confidence: (T, C, K).
        rate: Frames a second.

    Returns:
        The offsets; None where too little is seen to tell one of them.
    """
    count, seen = points.shape[1], despike(_confident(points, confidence, _MIN), _MIN_LEAP)
    rays = np.stack([viewing_rays(cameras, c, seen[:, c]) for c in range(count)], 1)
    trust, centres = np.clip(confidence, 0.0, 1.0), np.asarray(cameras.centre, np.float64)
    found = [shift for pair in combinations(range(count), 2) if (shift := _pair_shift(centres, rays, *pair, trust)) is not None]
    design = np.array([np.eye(count)[shift.cameras[1]] - np.eye(count)[shift.cameras[0]] for shift in found])
    design = design.reshape(-1, count)[:, 1:]
    if np.linalg.matrix_rank(design) < count - 1:
        return None
    systematic = np.array([shift.systematic(rate) for shift in found])
    weighted = design.T / (np.array([shift.variance for shift in found]) + systematic)
    inverse = np.linalg.solve(weighted @ design, weighted)
    moved = [inverse @ np.stack(each) for each in zip(*(shift.influences for shift in found), strict=True)]
    variance = inverse**2 @ systematic + sum((each**2).sum(1) for each in moved)
    return Offsets(np.append(0.0, inverse @ [shift.frames for shift in found]), np.append(0.0, np.sqrt(variance)))


def _pair_shift(centres: Floats, rays: Floats, a: int, b: int, trust: Floats) -> PairShift | None:
    """By how much camera b is later than a, from rays (T, C, K, 3) weighted by their trust (T, C, K); None if unknown."""
    rows = np.unique(np.linspace(0, len(rays) - 1, min(len(rays), _MAX_FRAMES)).astype(int))
    sure, shift = (trust[:, a] * trust[:, b])[rows], 0.0
    for _ in range(_ROUNDS):
        gap, ahead, behind = (_gaps(centres, rays, rows, a, b, shift + step) for step in (0.0, _STEP, -_STEP))
        known = np.isfinite(gap) & np.isfinite(ahead) & np.isfinite(behind)
        if known.sum() < _MIN_FRAMES * _MIN_POINTS:
            return None
        gap, ahead, behind = (np.where(known, each, 0.0) for each in (gap, ahead, behind))
        slope, bend = (ahead - behind) / (2 * _STEP), (ahead - 2 * gap + behind) / _STEP**2
        scale = max(1.4826 * float(np.median(np.abs(gap[known]))), 1e-6)
        weight = np.where(known, sure / (1 + (gap / scale) ** 2 / _FREEDOM), 0.0)
        squares, scores = weight * slope**2, weight * slope * gap
        if squares.sum() <= 0:
            return None
        curvature = max(float((squares + weight * gap * bend).sum()), _MIN_CURVATURE * float(squares.sum()))
        step = -float(scores.sum()) / curvature
        shift += float(np.clip(step, -2.0, 2.0))
        if abs(step) < 1e-2:
            break
    parts = np.arange(0, len(scores), max(1, len(scores) // _PARTS))

    def influence(grouped: Callable[[Floats], Floats]) -> Floats:
        share = np.minimum(grouped(squares) / squares.sum(), _LARGEST_SHARE)
        return np.asarray(grouped(scores) / (1 - share) / curvature)

    influences = influence(lambda of: of.sum(0)), influence(lambda of: np.add.reduceat(of, parts, axis=0).sum(1))
    return PairShift((a, b), shift, influences, float(known.any(1).mean()) * len(rays))


def _confident(points: Floats, confidence: Floats, least: float = _CONFIDENT) -> Floats:
    return np.where((confidence >= least)[..., None], points, np.nan)


def _smooth(rays: Floats, rows: Integers, shift: float) -> Floats:
    """Means (N, K, 3) of rays (T, K, 3) about places a shift beside some frames; NaN where one that counts is not seen."""
    steps = np.arange(int(np.floor(shift)) - _AROUND, int(np.ceil(shift)) + _AROUND + 1)
    weights = np.exp(-0.5 * (steps - shift) ** 2)
    total = np.zeros((len(rows), *rays.shape[1:]))
    for step, weight in zip(steps, weights / weights.sum(), strict=True):
        at = rows + step
        inside = (at >= 0) & (at < len(rays))
        total += weight * np.where(inside[:, None, None], rays[np.clip(at, 0, len(rays) - 1)], np.nan)
    return total


def _shift_costs(cameras: Cameras, a: int, first: Floats, b: int, second: Floats) -> dict[int, float]:
    """How far (mm) the nearest detections of two cameras pass each other, beside each point's median, by the second's shift."""
    centres = np.asarray(cameras.centre, np.float64)
    total, costs = len(first), {}
    for shift in range(-LARGEST_SHIFT, LARGEST_SHIFT + 1):
        rows = np.arange(max(0, -shift), min(total, total - shift))
        if len(rows) < max(_MIN_FRAMES, total // 4):
            continue
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MAX_FRAMES // 2)).astype(int))]
        apart = _distance(centres[a], first[rows][:, :, None], centres[b], second[rows + shift][:, None])
        common = np.isfinite(apart).sum(-1) >= _MIN_POINTS
        near = np.where(common, _median(np.abs(apart)), np.inf).reshape(len(rows), -1)
        seen = np.isfinite(near.min(1))
        if seen.sum() >= _MIN_FRAMES:
            nearest = apart.reshape(*near.shape, -1)[np.arange(len(rows)), near.argmin(1)][seen]
            usual = np.clip(_median(nearest.T), -_CALIBRATION, _CALIBRATION)
            costs[shift] = float(_median(np.abs(nearest - usual).ravel()))
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


def _gaps(centres: Floats, rays: Floats, rows: Integers, a: int, b: int, shift: float) -> Floats:
    """Signed distances (N, K) of the rays of two cameras, each half of the shift away, without the mean of each point."""
    first, second = _smooth(rays[:, a], rows, -shift / 2), _smooth(rays[:, b], rows, shift / 2)
    gaps = _distance(centres[a], first, centres[b], second)
    known = np.isfinite(gaps)
    values, weights = np.where(known, gaps, 0.0), known.astype(float)
    middle = np.zeros(values.shape[1:])
    for _ in range(5):
        middle = (weights * values).sum(0) / np.maximum(weights.sum(0), 1e-9)
        scale = np.sqrt((weights * (values - middle) ** 2).sum(0) / np.maximum(weights.sum(0), 1e-9)) + 1e-6
        weights = known / (1 + ((values - middle) / scale) ** 2 / _FREEDOM)
    return np.where(known & (known.sum(0) >= _MIN_FRAMES), gaps - middle, np.nan)
