"""Units of length in files, and which axis of a recording or a calibration points up.

The user's choice of the axis comes first, then what the file states. Without these the head of a person is above the feet: the
mean direction from the lower to the upper points, over all frames, chooses the axis if it lies near one. After it come a
skeleton's pose at rest, the longest extent of an upright body, and what is usual in the format.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, Location, Phrase, brief
from poseppl.motion.io.names import folded, without_prefixes

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4}
UNKNOWN_UNIT = Phrase("the calibration does not state its unit; metres are assumed (", Argument("unit"), " sets it)")


def mm_per_unit(unit: object, at: Location) -> float:
    """How many mm a unit has.

    Raises:
        InputError: It is none of the names in :data:`MM_PER_UNIT`.
    """
    if not isinstance(unit, str) or unit not in MM_PER_UNIT:
        raise at.error(f"unit {brief(unit)}", " or ".join(f'"{known}"' for known in MM_PER_UNIT))
    return MM_PER_UNIT[unit]


AXES = ("x", "y", "z", "-x", "-y", "-z")
_GIVEN = Phrase(Argument("up"), " says so")
_ALONG = 0.8
"""Length of the mean direction's part along an axis, at least: upright in most frames, and within 37 degrees of it."""
_FEW = 5
"""Fewer points than this have no longest extent."""
_LONGEST = 2.0
"""An extent that is so many times the next one is that of a person who stands."""
_UPPER = (
    "head|skull|crown|nose|eye|jaw|^[lr][fb]hd$",
    "neck|^c7$",
    "chest|clav|sternum|^strn$|shoulder|^[lr]sho$",
    "spine|thorax",
)
_LOWER = ("foot|toe|heel|ankle|^[lr](hee|ank|mt[0-9])$", "knee|^[lr]kne$", "pelvis|hip|root|asis|psis|^[lr](asi|psi|fwt|bwt)$")
"""Patterns of folded names, the points that are farthest up or down first."""


class VerticalAxis(NamedTuple):
    """The axis that points up.

    Attributes:
        axis: One of :data:`AXES`.
        reason: Why, for a message.
        certain: Whether data or the file say so; otherwise it is assumed.
    """

    axis: str
    reason: str
    certain: bool

    def note(self) -> Phrase:
        """Say which axis was taken, and how to choose another."""
        verb = "is" if self.certain else "is assumed to be"
        hint = () if self.reason == _GIVEN else (". ", Argument("up"), " sets another axis")
        return Phrase(f"{self.axis.upper()} {verb} up: ", self.reason, *hint)


def check_axis(up: str | None) -> None:
    """Check that an axis is None or one of :data:`AXES`.

    Raises:
        InputError: It is neither.
    """
    if up is not None and up not in AXES:
        raise Location(field=Argument("up")).error(f"{brief(up)} is no axis", ", ".join(AXES))


def vertical_axis(
    names: Sequence[str],
    positions: Floats,
    *,
    given: str | None = None,
    stated: str | None = None,
    stated_by: str = "",
    rest: Floats | None = None,
    usual: str,
    kind: str,
    agreed: bool = False,
) -> VerticalAxis:
    """Find the axis that points up.

    Args:
        names: K names of joints or markers.
        positions: (T, K, 3) in the file's axes, in any unit; NaN where unknown.
        given: The user's choice, which is not checked.
        stated: The axis that the file states.
        stated_by: The field that states it.
        rest: (K, 3) the skeleton at rest, if there is one.
        usual: The usual axis of the format.
        kind: The kind of file, for messages.
        agreed: Whether the format prescribes what is usual, so that the longest extent of points without names says nothing.
    """
    if given is not None:
        return VerticalAxis(given, _GIVEN, True)
    seen = _head_above_feet(names, positions)
    if stated is not None:
        if seen is None or seen == stated:
            return VerticalAxis(stated, f"{stated_by} says so", True)
        problem = f"{stated_by} says so, but the head is above the feet along {seen.upper()}"
        return VerticalAxis(stated, problem, False)
    if seen is not None:
        return VerticalAxis(seen, "the head is above the feet along it", True)
    if rest is not None and (at_rest := _head_above_feet(names, rest[None])) is not None:
        return VerticalAxis(at_rest, "the head is above the feet in the skeleton at rest", True)
    longest = None if agreed else _longest(positions)
    if longest is not None:
        return VerticalAxis(longest, "the body is longest along it, and neither names nor the file state an axis", False)
    return VerticalAxis(usual, f"this is usual in {kind}, and no body is upright along another axis", False)


def _head_above_feet(names: Sequence[str], positions: Floats) -> str | None:
    upper, lower = (_centre(names, positions, tiers) for tiers in (_UPPER, _LOWER))
    if upper is None or lower is None:
        return None
    away = upper - lower
    length = np.linalg.norm(away, axis=-1)
    known = np.isfinite(length) & (length > 0)
    if not known.any():
        return None
    direction = (away[known] / length[known, None]).mean(0)
    axis = int(np.abs(direction).argmax())
    return named_axis(axis, float(direction[axis])) if abs(direction[axis]) >= _ALONG else None


def _centre(names: Sequence[str], positions: Floats, patterns: Sequence[str]) -> Floats | None:
    """Mean (T, 3) of the points that are seen, of the first pattern that has some; NaN in frames without them."""
    plain = [folded(name) for name in without_prefixes(names)]
    for pattern in patterns:
        points = positions[:, [bool(re.search(pattern, name)) for name in plain]]
        seen = np.isfinite(points).all(-1, keepdims=True)
        if seen.any():
            count = seen.sum(1)
            return np.where(count > 0, np.where(seen, points, 0.0).sum(1) / np.maximum(count, 1), np.nan)
    return None


def _longest(positions: Floats) -> str | None:
    """The axis of the longest extent of the cloud in the middle frame, if it is by far the longest."""
    whole = positions[np.isfinite(positions).all((1, 2))]
    if not len(whole) or positions.shape[1] < _FEW:
        return None
    extents = np.median(np.ptp(whole, axis=1), axis=0)
    axis = int(extents.argmax())
    return named_axis(axis, 1.0) if extents[axis] >= _LONGEST * np.sort(extents)[-2] > 0 else None


def named_axis(axis: int, sign: float) -> str:
    """The name of axis 0, 1 or 2, or of the direction opposite to it."""
    return f"{'-' if sign < 0 else ''}{'xyz'[axis]}"
