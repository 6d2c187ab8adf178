"""Which joints in which frames of a result have low confidence, and why.

A joint has low confidence if fewer than two cameras saw it, or if a camera saw it far from its estimate. It also has low
confidence if the posterior SD of its position is large. Joints are judged relative to the body. Positions are the draws of
joint minus root; image points are corrected by the median shift of all of a camera's points in the frame. A cause that all
joints share (a camera that is turned, a body whose depth is unknown) is listed once, as `WHOLE`. Joints that no camera ever saw
are placed by the body alone.
"""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Booleans, Integers
from poseppl.diagnostics.selection import Array
from poseppl.motion.measures import named_root
from poseppl.motion.verdicts.residuals import ImageErrors, image_errors
from poseppl.runs.contents import draws_of, frame_numbers, names_of, variable

WIDE = 60.0
"""Standard deviation (root of the summed variances) of a position, mm, above which it has low confidence; ours."""
FAR = 4.0
"""A point that is off by more standard deviations than this has low confidence: of normal errors in the plane one in 3,000."""
MIN_COMMON = 5
"""The number of joints needed to decide what all of them share."""
WHOLE = "whole body"


class LowConfidenceSpan(NamedTuple):
    """Consecutive frames in which joints have low confidence for one reason.

    Attributes:
        joints: Their names, or `WHOLE` for what all of them share.
        first: Number of the first frame.
        last: Number of the last one.
        num_frames: How many there are.
        reason: In words.
        spread: Largest posterior standard deviation among them, mm; of joints relative to the root, of `WHOLE` the root's.
    """

    joints: tuple[str, ...]
    first: int
    last: int
    num_frames: int
    reason: str
    spread: float


class Doubts(NamedTuple):
    """Low confidence in a result's K joints; the last column is for what all joints share.

    Attributes:
        reasons: (T, K + 1) index of the first reason into `words`; -1 where there is none.
        words: The reasons.
        spread: (T, K + 1) standard deviation of each position, mm: of joints relative to `root`, last that of the root.
        root: Name of the joint that positions are relative to; "the centre of all points" where none is a root.
        unseen: Names of the joints that no camera ever saw.
    """

    reasons: Integers
    words: list[str]
    spread: Array
    root: str
    unseen: list[str]


class _Reason(NamedTuple):
    """A reason, and where it applies: to joints (T, K), and to all of them (T,)."""

    words: str
    joints: Booleans
    whole: Booleans


def doubts_of(tree: xr.DataTree) -> Doubts | None:
    """Find the low confidence in a result; None if it has no joints in space."""
    draws = draws_of(tree, "markers")
    if draws is None or variable(tree, "summary", "markers_sd") is None:
        return None
    names, errors, root = names_of(tree, "marker", "summary"), image_errors(tree), named_root(tree)
    spread, where = _spread(draws, root), "the centre of all points" if root is None else names[root]
    wide = spread > WIDE
    found = [] if errors is None else _of_images(errors)
    nothing = np.zeros_like(wide[:, :-1])
    found += [
        _Reason(f"posterior SD above {WIDE:g} mm, relative to {where}", wide[:, :-1], nothing[:, 0]),
        _Reason(f"posterior SD of {where} above {WIDE:g} mm", nothing, wide[:, -1]),
    ]
    holds = np.stack([np.column_stack([each.joints, each.whole]) for each in found])
    reasons = np.where(holds.any(axis=0), holds.argmax(axis=0), -1)
    never = [] if errors is None else np.flatnonzero(np.isnan(errors.distance).all((0, 1))).tolist()
    return Doubts(reasons, [each.words for each in found], spread, where, [names[k] for k in never])


def _spread(draws: Array, root: int | None) -> Array:
    """Standard deviations (T, K + 1) of draws (chain, draw, T, K, 3), relative to the root or the centre; last that of it."""
    centre = draws.mean(axis=3, dtype=np.float64) if root is None else draws[:, :, :, root]
    each = [draws[:, :, :, k] - centre for k in range(draws.shape[3])] + [centre]
    return np.stack([np.linalg.norm(part.std(axis=(0, 1), dtype=np.float64), axis=-1) for part in each], axis=1)


def _of_images(errors: ImageErrors) -> list[_Reason]:
    """Reasons that image points give, the most severe first."""
    seen = np.isfinite(errors.distance)
    count, ever = seen.sum(1), np.asarray(seen.any((0, 1)))
    found = [_split("seen by no camera", (count == 0) & ever, ever)]
    if len(errors.cameras) > 1:
        found.append(_split("seen by one camera only", (count == 1) & ever, ever))
    shift = _shift(errors, seen)
    with np.errstate(invalid="ignore"):
        far = np.linalg.norm(errors.residual - shift[:, :, None], axis=-1) > FAR * errors.noise
        moved = np.linalg.norm(shift, axis=-1) > FAR * errors.noise.max(-1, initial=0.0, where=seen)
    for c, name in enumerate(errors.cameras):
        never = np.zeros_like(moved[:, c])
        found.append(_Reason(f"far from its detections in {name}", far[:, c], never))
        found.append(_Reason(f"far from all detections in {name}", np.zeros_like(far[:, c]), moved[:, c]))
    return found


def _split(words: str, joints: Booleans, ever: Booleans) -> _Reason:
    """A finding about all joints that are ever seen is reported for the whole body, and for no joint."""
    whole = joints[:, ever].all(axis=1) & (ever.sum() >= MIN_COMMON)
    return _Reason(words, joints & ~whole[:, None], whole)


def _shift(errors: ImageErrors, seen: Booleans) -> Array:
    """Median residual (T, C, 2) of a frame's points in each camera; 0 if too few are seen to decide."""
    known = np.where((seen.sum(-1) >= MIN_COMMON)[..., None, None], errors.residual, 0.0)
    return np.asarray(np.nanmedian(known, axis=2))


def doubts_in_a_row(tree: xr.DataTree, doubts: Doubts) -> list[LowConfidenceSpan]:
    """Low confidence as spans of frames, the most severe, by frames times mm, first; joints of equal spans together."""
    frames, names = frame_numbers(tree), [*names_of(tree, "marker", "summary"), WHOLE]
    found: dict[tuple[int, int, int], list[int]] = {}
    for k in range(len(names)):
        for reason, stretch in groupby(enumerate(doubts.reasons[:, k].tolist()), itemgetter(1)):
            rows = [row for row, _ in stretch]
            if reason >= 0:
                found.setdefault((rows[0], rows[-1], reason), []).append(k)
    spans = [
        LowConfidenceSpan(
            tuple(names[k] for k in joints),
            int(frames[first]),
            int(frames[last]),
            last - first + 1,
            doubts.words[reason],
            float(doubts.spread[first : last + 1, joints].max()),
        )
        for (first, last, reason), joints in found.items()
    ]
    return sorted(spans, key=lambda each: -each.num_frames * max(each.spread, 1.0))
