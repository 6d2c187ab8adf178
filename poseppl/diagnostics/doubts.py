"""Which joints in which frames of a result not to trust, and why.

A joint is doubted where fewer cameras than two saw it, where a camera saw it far from where it is said to be, and where its
place is known to some centimetres only. Joints that no camera ever saw are placed by the body alone; they are doubted for their
width.
"""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Integers
from poseppl.diagnostics.image_errors import ImageErrors, image_errors
from poseppl.diagnostics.selection import Array
from poseppl.runs.contents import frame_numbers, names_of, variable

WIDE = 60.0
"""A joint whose place has a standard deviation (root of the summed variances) above this, mm, is doubted; ours."""
FAR = 4.0
"""A point that is off by more standard deviations than this is doubted: of normal errors in the plane one in 3,000."""


class Doubt(NamedTuple):
    """Frames in a row in which a joint is doubted for one reason.

    Attributes:
        joint: Its name.
        first: Number of the first frame.
        last: Number of the last one.
        num_frames: How many there are.
        reason: In words.
        spread: Largest standard deviation of its place among them, mm.
    """

    joint: str
    first: int
    last: int
    num_frames: int
    reason: str
    spread: float


class Doubts(NamedTuple):
    """The doubts of a result.

    Attributes:
        reasons: (T, K) index of the first reason into `words`; -1 where there is none.
        words: The reasons.
        spread: (T, K) standard deviation of each place, mm.
        unseen: Names of the joints that no camera ever saw.
    """

    reasons: Integers
    words: list[str]
    spread: Array
    unseen: list[str]


def doubts_of(tree: xr.DataTree) -> Doubts | None:
    """Find the doubts of a result; None where it holds no joints in space."""
    sd = variable(tree, "summary", "markers_sd")
    if sd is None:
        return None
    spread = np.asarray(np.linalg.norm(sd, axis=-1))
    names, errors = names_of(tree, "marker", "summary"), image_errors(tree)
    found = [] if errors is None else _of_images(errors)
    found.append((f"known to more than {WIDE:g} mm", spread > WIDE))
    holds = np.stack([where for _, where in found])
    reasons = np.where(holds.any(axis=0), holds.argmax(axis=0), -1)
    never = [] if errors is None else np.flatnonzero(np.isnan(errors.distance).all((0, 1))).tolist()
    return Doubts(reasons, [words for words, _ in found], spread, [names[k] for k in never])


def _of_images(errors: ImageErrors) -> list[tuple[str, Array]]:
    """Reasons and where they hold (T, K), those that weigh most first."""
    seen = np.isfinite(errors.distance)
    count, ever = seen.sum(1), seen.any((0, 1))
    found = [("seen by no camera", (count == 0) & ever)]
    if len(errors.cameras) > 1:
        found.append(("seen by one camera alone", (count == 1) & ever))
    with np.errstate(invalid="ignore"):
        far = errors.distance > FAR * errors.noise
    return found + [(f"far from where {name} saw it", far[:, c]) for c, name in enumerate(errors.cameras)]


def doubts_in_a_row(tree: xr.DataTree, doubts: Doubts) -> list[Doubt]:
    """The doubts as stretches of frames, those that weigh most, by frames times mm, first."""
    frames, names = frame_numbers(tree), names_of(tree, "marker", "summary")
    found = []
    for k, name in enumerate(names):
        for reason, stretch in groupby(enumerate(doubts.reasons[:, k].tolist()), itemgetter(1)):
            rows = [row for row, _ in stretch]
            if reason >= 0:
                first, last = int(frames[rows[0]]), int(frames[rows[-1]])
                found.append(Doubt(name, first, last, len(rows), doubts.words[reason], float(doubts.spread[rows, k].max())))
    return sorted(found, key=lambda each: -each.num_frames * each.spread)
