"""A recorded motion at another rate: frames left out where the rates divide evenly, and points between two frames elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from poseppl.errors import Location
from poseppl.motion.io.motion import Motion

RATE_TOLERANCE = 1e-3
"""By which share of it a rate may miss a whole fraction of another."""


def whole_step(rate: float, wanted: float) -> int | None:
    """Every which frame of a rate makes it another one; None if there is none.

    >>> whole_step(120.0, 30.0), whole_step(119.9, 60.0), whole_step(120.0, 25.0), whole_step(30.0, 60.0)
    (4, 2, None, None)
    """
    step = round(rate / wanted)
    return step if step >= 1 and abs(rate / wanted - step) <= RATE_TOLERANCE * step else None


def resample(motion: Motion, rate: float) -> Motion:
    """Bring a motion to a lower rate.

    If every n-th frame has that rate, these frames are selected. Otherwise points lie on the straight line between the frames
    before and after their time; a point that is missing in either frame is missing. An arm of 600 mm that swings by 6 radians a
    second is 0.2 mm short in the middle between frames of 120 Hz.

    Args:
        motion: The motion, T frames.
        rate: Frames a second.

    Returns:
        The motion from the same first frame on.

    Raises:
        InputError: The rate is none, or higher than the motion's.
    """
    if not 0 < rate <= motion.rate * (1 + RATE_TOLERANCE):
        problem = f"{motion.rate:g} frames a second cannot be made {rate:g}"
        raise Location(motion.source).error(problem, f"above 0, at most {motion.rate:g}")
    step = whole_step(motion.rate, rate)
    if step is not None:
        return replace(motion, positions=motion.positions[::step], rate=motion.rate / step)
    last = len(motion.positions) - 1
    times = np.arange(int(last * rate / motion.rate + 1e-9) + 1) * (motion.rate / rate)
    before = np.minimum(times.astype(int), last)
    share = (times - before)[:, None, None]
    start, end = motion.positions[before], motion.positions[np.minimum(before + 1, last)]
    return replace(motion, positions=np.where(share > 0, (1 - share) * start + share * end, start), rate=rate)
