"""Heel strikes and toe-offs of a walk, in each draw of a smoothed result, and so with intervals.

The method needs no force plate and works on treadmills as well. Both events are found along the direction of the pelvis:

* Toes leave the floor when they are farthest behind the pelvis (Zeni, Richards and Higginson 2008,
  doi:10.1016/j.gaitpost.2007.07.007).
* A heel is farthest in front of the pelvis while it still moves over the floor as fast as the pelvis. It strikes afterwards,
  when its speed has fallen to half of the walking speed (Bonci et al. 2022, doi:10.3389/fbioe.2022.868928).

The floor moves as standing toes do: not at all, or with the belt of a treadmill. The walking speed is that of the pelvis over
the floor, averaged over a second. Positions are low-passed at 6 Hz (Butterworth of fourth order, forwards and backwards). Times
between frames are interpolated. A body without feet has ankles in place of both.

An extreme is found in the mean first; in each draw the event is the nearest of that draw, within a fifth of a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, find_peaks, sosfiltfilt

from poseppl.arrays import Floats, Integers
from poseppl.errors import InputError

CUTOFF = 6.0
"""Hz."""
NEAR, APART, AVERAGED = 0.2, 0.5, 1.0
"""Seconds: from an extreme to an event, between two events of a kind, and of the running mean of the pelvis's direction and
speed; our choice."""
STRIKE = 0.5
"""Speed over the floor of a heel that strikes, as a share of the walking speed (Bonci et al. 2022)."""
STANDING = 0.3
"""Share of the time in which toes are slower than the floor's estimate: half of the usual stance of 60 %; our choice."""
SMALLEST = 150.0
"""Smallest distance of a foot's foremost and hindmost positions in a walk, mm; our choice."""
PROMINENCE = 0.3
"""Smallest prominence of an extreme, as a share of that range; our choice."""

Side = Literal["l", "r"]
Kind = Literal["strike", "off"]


class GaitEvent(NamedTuple):
    """An event.

    Attributes:
        kind: "strike" of the heel or "off" of the toes.
        side: "l" or "r".
        times: In each draw (S,), seconds; NaN in a draw that has none.
    """

    kind: Kind
    side: Side
    times: Floats

    @property
    def mean(self) -> float:
        """Mean time, seconds."""
        return float(np.nanmean(self.times))


class WalkDraws(NamedTuple):
    """Draws of a walk.

    Attributes:
        times: (T,) seconds, evenly spaced.
        forward: (T, 2) unit vectors, the direction in which the pelvis faces on the floor.
        pelvis: (S, T, 3) mm, Z up, low-passed: the middle between the hips.
        heel: By side, (S, T, 3) mm.
        toe: By side, (S, T, 3) mm.
        feet: Whether these are of feet; ankles otherwise.
    """

    times: Floats
    forward: Floats
    pelvis: Floats
    heel: dict[Side, Floats]
    toe: dict[Side, Floats]
    feet: bool

    def ahead(self, places: Floats) -> Floats:
        """How far places (S, T, 3) are in front of the pelvis (S, T), mm."""
        return np.asarray(np.einsum("sti,ti->st", (places - self.pelvis)[..., :2], self.forward))

    def speed(self, places: Floats) -> Floats:
        """How fast places (S, T, 3) move forward (S, T), mm a second."""
        velocity = np.gradient(places[..., :2], float(self.times[1] - self.times[0]), axis=1)
        return np.asarray(np.einsum("sti,ti->st", velocity, self.forward))


def walk_draws(places: Floats, names: Sequence[str], times: Floats) -> WalkDraws:
    """Take what gait needs from draws of a body's markers.

    Args:
        places: (S, T, K, 3) mm, Z up; K markers that were seen.
        names: Their names.
        times: (T,) seconds.

    Raises:
        InputError: Hips or ankles are missing, frames are fewer than a second, or unevenly spaced.
    """
    needed = [f"{part}_{side}" for part in ("hip", "ankle") for side in "lr"]
    missing = [name for name in needed if name not in names]
    if missing:
        raise InputError(f"the result has no {', '.join(missing)}", expected="a person whose hips and ankles were seen")
    gaps = np.diff(times)
    if len(times) < 3 or times[-1] - times[0] < 1.0 or not np.allclose(gaps, gaps.mean(), rtol=0.01):
        problem = f"{len(times)} frames in {times[-1] - times[0]:.2f} s"
        raise InputError(problem, expected="frames in equal steps, over a second or more")
    rate = 1 / float(gaps.mean())

    def smoothed(name: str) -> Floats:
        return _low_pass(places[:, :, list(names).index(name)], rate)

    hips = {side: smoothed(f"hip_{side}") for side in ("l", "r")}
    right = (hips["r"] - hips["l"]).mean(0)[:, :2]
    facing = np.stack([-right[:, 1], right[:, 0]], 1)  # up x right
    facing = _averaged(facing, 1 / rate)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    feet = all(f"{part}_{side}" in names for part in ("heel", "big_toe") for side in "lr")
    ends = ("heel", "big_toe") if feet else ("ankle", "ankle")
    heel, toe = ({side: smoothed(f"{end}_{side}") for side in ("l", "r")} for end in ends)
    return WalkDraws(times, facing, (hips["l"] + hips["r"]) / 2, heel, toe, feet)  # type: ignore[arg-type]


def gait_events(walk: WalkDraws, strike: float = STRIKE) -> list[GaitEvent]:
    """Find the events, in order of their mean times.

    Args:
        walk: The walk.
        strike: Speed over the floor of a heel that strikes, as a share of the walking speed.

    Raises:
        InputError: Feet do not go to and fro beside the pelvis.
    """
    step = float(walk.times[1] - walk.times[0])
    pelvis = walk.speed(walk.pelvis)
    floor = float(np.quantile([walk.speed(toe).mean(0) for toe in walk.toe.values()], STANDING))
    striking = floor + strike * (_averaged(pelvis.mean(0), step) - floor)
    found: list[GaitEvent] = []
    for side, heel in walk.heel.items():
        toe = walk.toe[side]
        signals: tuple[tuple[Kind, Floats, Floats], ...] = (
            ("strike", walk.ahead(heel), walk.speed(heel) - striking),
            ("off", -walk.ahead(toe), pelvis - walk.speed(toe)),
        )
        for kind, signal, falling in signals:
            for peak in _peaks(signal.mean(0), step):
                at = _nearest_fall(falling, peak, NEAR / step)
                if np.isfinite(at).mean() > 0.5:
                    found.append(GaitEvent(kind, side, walk.times[0] + step * at))
    if not any(event.kind == "strike" for event in found):
        raise InputError("no foot moves to and fro relative to the pelvis", expected="a walk of at least one stride")
    return sorted(found, key=lambda event: event.mean)


def _peaks(mean: Floats, step: float) -> Integers:
    """Frames of the maxima of a signal (T,); none where it hardly changes."""
    span = float(np.ptp(mean))
    if span < SMALLEST:
        return np.zeros(0, int)
    return np.asarray(find_peaks(mean, prominence=PROMINENCE * span, distance=max(1, round(APART / step)))[0])


def _nearest_fall(signal: Floats, peak: float, near: float) -> Floats:
    """Frames (S,) in which signals (S, T) fall through 0 nearest to a peak; NaN if that is farther than ``near`` frames."""
    before, after = signal[:, :-1], signal[:, 1:]
    falls = (before > 0) & (after <= 0)
    share = before / np.where(falls, before - after, 1.0)
    away = np.where(falls, np.arange(before.shape[1]) + share - peak, np.inf)
    nearest = np.take_along_axis(away, np.abs(away).argmin(1)[:, None], 1)[:, 0]
    return np.where(np.abs(nearest) <= near, peak + nearest, np.nan)


def _averaged(values: Floats, step: float) -> Floats:
    """Running mean of values (T, ...) over a second."""
    return np.asarray(uniform_filter1d(values, max(1, round(AVERAGED / step)), axis=0, mode="nearest"))


def _low_pass(values: Floats, rate: float) -> Floats:
    """Values (S, T, 3) without what is above the cutoff."""
    if rate <= 2.2 * CUTOFF:
        return values
    return np.asarray(sosfiltfilt(butter(2, CUTOFF, fs=rate, output="sos"), values, axis=1))
