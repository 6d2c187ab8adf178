"""Gait of a smoothed result: events, steps, strides and joint angles over the cycle, each with an interval.

Every figure is computed in each draw of the posterior, from that draw's own events. Intervals of means say how well these
strides are known, not how much another stride would differ: for that see the standard deviation between strides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.opensim import Coordinate
from poseppl.motion.tracking.estimates import angle_draws, clock_of, unseen_of
from poseppl.motion.tracking.gait_events import GaitEvent, Side, WalkDraws, gait_events, walk_draws
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import provenance

NUM_DRAWS = 200
"""That are used at most, evenly spaced."""
PHASES = 101
"""Points of the cycle, from 0 to 100 %."""
SLOW = 200.0
"""mm a second, of the pelvis; someone who walks on the spot at less is on a treadmill, whose lengths do not show. Ours."""
LONGEST_STRIDE = 2.5
"""Seconds; strikes that are farther apart are not of successive strides. Ours."""
ANGLES = ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle", "ankle_angle", "subtalar_angle")
"""Angles of a leg, without their side, whose cycle is shown with those of the :data:`PELVIS`."""
PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")


class Measure(NamedTuple):
    """A figure of gait.

    Attributes:
        name: Such as "stride length".
        side: "l" or "r" of the foot that ends the step or stride; "" of both.
        unit: Its unit.
        draws: (S,), each the mean over strides or steps; NaN in a draw that has none.
        number: Number of strides or steps.
        between: Standard deviation between these of their means over draws; NaN for one alone.
    """

    name: str
    side: str
    unit: str
    draws: Floats
    number: int
    between: float


class Cycle(NamedTuple):
    """An angle over the gait cycle, from heel strike to heel strike.

    Attributes:
        name: Name of the coordinate.
        side: Whose cycle.
        draws: (S, 101) degrees, the mean over strides.
        between: (101,) standard deviation between strides, of their means over draws; NaN for one alone.
        number: Number of strides.
    """

    name: str
    side: Side
    draws: Floats
    between: Floats
    number: int


class Gait(NamedTuple):
    """Gait of a result.

    Attributes:
        events: In order of time.
        measures: Figures.
        cycles: Angles over the cycle; none where the result's body is not installed and not named.
        notes: Notes for the reader, a sentence each.
        walk: Draws of the walk whose events these are.
    """

    events: list[GaitEvent]
    measures: list[Measure]
    cycles: list[Cycle]
    notes: list[str]
    walk: WalkDraws


def gait_of(tree: xr.DataTree, *, model: str | None = None) -> Gait:
    """Find events and figures of a walk.

    Args:
        tree: A smoothed result of a person, whose draws are whole trajectories.
        model: Builder of the body, where the result's own is not installed.

    Raises:
        InputError: The result is not smoothed, has no hips and ankles, or nobody walks in it.
    """
    if provenance(tree).get("joint") is not True:
        expected = "a result of poseppl smooth, or of poseppl track keypoints in several cameras"
        raise InputError("its draws are of single frames, not of whole trajectories", expected=expected)
    kept, clock = variable(tree, "posterior", "markers"), clock_of(tree)
    if kept is None:
        raise InputError("the result has no joints in space", expected="a result of a person")
    places = kept.reshape(-1, *kept.shape[2:])
    chosen = np.unique(np.linspace(0, len(places) - 1, min(NUM_DRAWS, len(places))).astype(int))
    unseen, names = unseen_of(tree), names_of(tree, "marker")
    seen = [k for k, name in enumerate(names) if name not in unseen.markers]
    walk = walk_draws(np.asarray(places[chosen][:, :, seen], np.float64), [names[k] for k in seen], clock.times)
    events = gait_events(walk)
    coordinates, values = angle_draws(tree, model)
    known = [k for k, each in enumerate(coordinates) if each.name not in unseen.coordinates]
    cycles = list(_cycles(events, clock.times, [coordinates[k] for k in known], values[chosen][:, :, known]))
    notes = [] if walk.feet else ["No camera found heels and toes: events are those of the ankles, and less exact."]
    if clock.assumed:
        notes.append(f"The frame rate is unknown: {clock.rate:g} frames a second are assumed.")
    measures, more = _measures(walk, events)
    return Gait(events, measures, cycles, [*notes, *more], walk)


def _measures(walk: WalkDraws, events: Sequence[GaitEvent]) -> tuple[list[Measure], list[str]]:
    """Figures, and what is to be said of them."""
    strides, steps = list(strides_of(events)), list(steps_of(events))
    moves = float(np.linalg.norm(np.diff(walk.pelvis.mean(0)[[0, -1], :2], axis=0)) / (walk.times[-1] - walk.times[0])) > SLOW
    found = [*_by_side("stride time", "s", strides, time_between), *_by_side("step time", "s", steps, time_between)]
    if moves:
        found += _by_side("stride length", "m", strides, lambda a, b: heel_path(walk, a, b))
        found += _by_side("step length", "m", steps, lambda a, b: between_feet(walk, a, b)[0])
        found += _by_side("step width", "m", steps, lambda a, b: between_feet(walk, a, b)[1])
    found += _by_side("stance", "% of the stride", strides, lambda a, b: _stance(events, a, b))
    if steps:
        found.append(_measure("cadence", "", "steps/min", steps, lambda a, b: 60 / time_between(a, b)))
    if moves and strides:
        found.append(_measure("walking speed", "", "m/s", strides, lambda a, b: heel_path(walk, a, b) / time_between(a, b)))
    warnings = [] if moves else ["The person stays in place: lengths and speed of a treadmill's walk do not show."]
    return [each for each in found if np.isfinite(each.draws).any()], warnings


def strides_of(events: Sequence[GaitEvent]) -> Iterator[tuple[GaitEvent, GaitEvent]]:
    """Successive strikes of a side."""
    for side in "lr":
        for pair in pairwise(event for event in events if (event.kind, event.side) == ("strike", side)):
            if time_between(*pair).mean() < LONGEST_STRIDE:
                yield pair


def steps_of(events: Sequence[GaitEvent]) -> Iterator[tuple[GaitEvent, GaitEvent]]:
    """Successive strikes of different sides."""
    for first, last in pairwise(event for event in events if event.kind == "strike"):
        if first.side != last.side and time_between(first, last).mean() < LONGEST_STRIDE / 2:
            yield first, last


Pairs = Sequence[tuple[GaitEvent, GaitEvent]]


def _by_side(name: str, unit: str, pairs: Pairs, of: Callable[[GaitEvent, GaitEvent], Floats]) -> list[Measure]:
    chosen = {side: [pair for pair in pairs if pair[1].side == side] for side in "lr"}
    return [_measure(name, side, unit, own, of) for side, own in chosen.items() if own]


def _measure(name: str, side: str, unit: str, pairs: Pairs, of: Callable[[GaitEvent, GaitEvent], Floats]) -> Measure:
    each = np.stack([of(*pair) for pair in pairs])  # (strides, S)
    each = each[np.isfinite(each).any(1)]
    if not len(each):
        return Measure(name, side, unit, np.full(len(pairs[0][0].times), np.nan), 0, np.nan)
    between = float(np.nanmean(each, axis=1).std(ddof=1)) if len(each) > 1 else np.nan
    return Measure(name, side, unit, each.mean(0), len(each), between)


def time_between(first: GaitEvent, last: GaitEvent) -> Floats:
    """Seconds (S,) between two events."""
    return last.times - first.times


def _at(walk: WalkDraws, places: Floats, times: Floats) -> Floats:
    """Places (S, 2) on the floor at a time of each draw (S,), m."""
    frame = np.clip((times - walk.times[0]) / (walk.times[1] - walk.times[0]), 0, len(walk.times) - 1)
    known = np.nan_to_num(frame)
    below = np.minimum(known.astype(int), len(walk.times) - 2)
    share, rows = (known - below)[:, None], np.arange(len(places))
    at = (1 - share) * places[rows, below, :2] + share * places[rows, below + 1, :2]
    return np.asarray(np.where(np.isfinite(frame)[:, None], at, np.nan) / 1000.0)


def heel_path(walk: WalkDraws, first: GaitEvent, last: GaitEvent) -> Floats:
    """How far a heel goes from strike to strike (S,), m."""
    heel = walk.heel[first.side]
    return np.asarray(np.linalg.norm(_at(walk, heel, last.times) - _at(walk, heel, first.times), axis=1))


def between_feet(walk: WalkDraws, first: GaitEvent, last: GaitEvent) -> tuple[Floats, Floats]:
    """From the other heel, where it struck, to the heel that strikes (S,): along the way of the pelvis, and across; m."""
    away = _at(walk, walk.heel[last.side], last.times) - _at(walk, walk.heel[first.side], first.times)
    way = _at(walk, walk.pelvis, last.times) - _at(walk, walk.pelvis, first.times)
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    return np.sum(away * way, 1), np.abs(away[:, 0] * way[:, 1] - away[:, 1] * way[:, 0])


def _stance(events: Sequence[GaitEvent], first: GaitEvent, last: GaitEvent) -> Floats:
    """Share of a stride (S,) before the toes leave the floor, %; NaN where they are not seen to."""
    for event in events:
        if event.kind == "off" and event.side == first.side and first.mean < event.mean < last.mean:
            return 100 * time_between(first, event) / time_between(first, last)
    return np.full_like(first.times, np.nan)


def _cycles(events: Sequence[GaitEvent], times: Floats, coordinates: Sequence[Coordinate], values: Floats) -> Iterator[Cycle]:
    """Angles (S, T, coordinates) over the cycle of each side."""
    column = {each.name: k for k, each in enumerate(coordinates)}
    sides: tuple[Side, Side] = ("l", "r")
    for side in sides:
        strides = [pair for pair in strides_of(events) if pair[0].side == side]
        for name in (*PELVIS, *(f"{name}_{side}" for name in ANGLES)):
            if strides and name in column:
                yield _cycle(name, side, strides, times, np.unwrap(values[:, :, column[name]], axis=1, period=360.0))


def _cycle(name: str, side: Side, strides: Pairs, times: Floats, angle: Floats) -> Cycle:
    """An angle (S, T) over strides."""
    phase = np.linspace(0.0, 1.0, PHASES)
    each = np.full((len(strides), len(angle), PHASES), np.nan)
    for number, (first, last) in enumerate(strides):
        for draw, (start, end) in enumerate(zip(first.times, last.times, strict=True)):
            if np.isfinite(start + end):
                each[number, draw] = np.interp(start + phase * (end - start), times, angle[draw])
    turn = 360.0 * np.round(np.nanmean(each, axis=(1, 2), keepdims=True) / 360.0)
    each = each - turn
    between = np.nanmean(each, axis=1).std(0, ddof=1) if len(each) > 1 else np.full(PHASES, np.nan)
    return Cycle(name, side, each.mean(0), between, len(each))


def quantiles(draws: Floats, level: float) -> tuple[Floats, Floats, Floats]:
    """Mean, and the ends of the central interval, over the first axis, of the draws that are known.

    Raises:
        InputError: The level is no share.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"{level:g}", field=Argument("level"), expected="a share between 0 and 1, such as 0.9")
    lower, upper = np.nanquantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
    return np.nanmean(draws, axis=0), lower, upper


WORDS: Mapping[str, str] = {"strike": "heel strike", "off": "toe off", "l": "left", "r": "right", "": "both"}
"""Words for kinds and sides."""


def event_rows(gait: Gait, level: float) -> list[tuple[str, str, float, float, float]]:
    """Rows of events: event, side, mean time, lower and upper end, s."""
    rows = []
    for event in gait.events:
        mean, lower, upper = map(float, quantiles(event.times, level))
        rows.append((WORDS[event.kind], WORDS[event.side], mean, lower, upper))
    return rows


def measure_rows(gait: Gait, level: float) -> list[tuple[str, str, str, int, float, float, float, float]]:
    """Rows of figures: figure, side, unit, number of steps or strides, mean, lower and upper end, SD between them."""
    rows = []
    for m in gait.measures:
        mean, lower, upper = map(float, quantiles(m.draws, level))
        rows.append((m.name, WORDS[m.side], m.unit, m.number, mean, lower, upper, m.between))
    return rows


def cycle_rows(gait: Gait, level: float) -> Iterator[tuple[str, str, int, float, float, float]]:
    """Rows of angles over the cycle: coordinate, side, per cent, mean, lower and upper end, degrees."""
    for cycle in gait.cycles:
        for percent, (mean, lower, upper) in enumerate(zip(*quantiles(cycle.draws, level), strict=True)):
            yield cycle.name, WORDS[cycle.side], percent, float(mean), float(lower), float(upper)
