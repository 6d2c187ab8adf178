"""Events and figures of a walk that is known in closed form, and of a result."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_bodies import drawn_result
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.gait import walk

from poseppl.errors import InputError
from poseppl.motion.bodies.opensim import opensim_coordinates
from poseppl.motion.tracking.gait import _cycles, _measures, gait_of, quantiles
from poseppl.motion.tracking.gait_events import WalkDraws, gait_events, walk_draws

RATE, PERIOD, AHEAD, WIDTH, STANCE = 100.0, 1.1, 300.0, 90.0, 0.62
TIMES = np.arange(440) / RATE
NAMES = [f"{part}_{side}" for part in ("hip", "ankle", "heel", "big_toe") for side in "lr"]
STRIKES = {"r": 0.4, "l": 0.4 + PERIOD / 2}
"""When heels are first farthest in front of the pelvis, seconds."""
TURN = 2 * np.pi / PERIOD
LATE = np.arcsin(0.5 * np.cos(0.3 * np.pi)) / TURN
"""From there to a strike, seconds: toes whose speed is a sine are slower than the mean by cos(0.3 pi) in 30 % of the time."""


def places(speed: float = 1300.0, heading: float = 0.4, late: tuple[float, ...] = (0.0,), feet: bool = True) -> np.ndarray:
    """Draws (S, T, K, 3) of a walk: heels and toes swing as cosines beside a pelvis of constant speed, mm a second."""
    along, across = np.array([np.cos(heading), np.sin(heading), 0.0]), np.array([np.sin(heading), -np.cos(heading), 0.0])
    found = np.zeros((len(late), len(TIMES), len(NAMES), 3))
    for draw, delay in enumerate(late):
        for k, name in enumerate(NAMES):
            part, _, side = name.rpartition("_")
            sign = 1.0 if side == "r" else -1.0
            own = WIDTH / 2 * sign * across + speed * TIMES[:, None] * along
            # toes are farthest behind the pelvis when they leave the floor
            turn = {"hip": np.nan, "big_toe": STRIKES[side] + (STANCE - 0.5) * PERIOD}.get(part, STRIKES[side]) + delay
            swing = AHEAD * np.cos(2 * np.pi * (TIMES - turn) / PERIOD)
            found[draw, :, k] = own + np.nan_to_num(swing)[:, None] * along
    return found if feet else found[:, :, :4]


@pytest.mark.parametrize("heading", [0.4, 3.0])
def test_strikes_and_offs(heading: float) -> None:
    late = (-0.02, 0.0, 0.03)
    events = gait_events(walk_draws(places(heading=heading, late=late), NAMES, TIMES))
    assert [event.mean for event in events] == sorted(event.mean for event in events)
    for kind, side, first in (
        *(("strike", side, first + LATE) for side, first in STRIKES.items()),
        *(("off", side, first + (STANCE - 1) * PERIOD) for side, first in STRIKES.items()),
    ):
        expected = first + PERIOD * np.arange(-1, 5)
        expected = expected[(expected > 0.25) & (expected < TIMES[-1] - 0.25)]
        own = [event.times for event in events if (event.kind, event.side) == (kind, side)]
        near = [min(own, key=lambda times, at=at: abs(times.mean() - at)) for at in expected]
        np.testing.assert_allclose(np.array(near) - expected[:, None], np.tile(late, (len(expected), 1)), atol=0.002)


@pytest.mark.parametrize("speed", [1300.0, 0.0])
def test_feet_that_stand_brake_and_push(speed: float) -> None:
    """Speeds over the floor are trapezia of time, so that events have closed forms: without a filter, and on a treadmill."""
    times, late = np.arange(800) / 200.0, np.array([0.0, 0.02])
    stand, swing = np.array([0.0, 0.4, 0.6, 0.8, 1.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0])
    fastest = 1300.0 / np.trapezoid(swing, stand)  # a heel goes as far in a second as the pelvis

    def foot(side: float, shift: float) -> np.ndarray:
        since = (times - shift - side / 2 - late[:, None]) % 1.0
        relative = fastest * np.interp(since, stand, swing) - 1300.0
        moved = np.cumsum((relative[:, 1:] + relative[:, :-1]) / 400.0, axis=1)
        ahead = np.concatenate([np.zeros((2, 1)), moved], 1) + speed * times
        return np.stack([ahead, np.full_like(ahead, 90 * side), np.zeros_like(ahead)], -1)

    pelvis = np.zeros((2, len(times), 3))
    pelvis[..., 0] = speed * times
    forward = np.tile([1.0, 0.0], (len(times), 1))
    heel, toe = ({"r": foot(0.0, shift), "l": foot(1.0, shift)} for shift in (0.3, 0.45))
    events = gait_events(WalkDraws(times, forward, pelvis, heel, toe, True))
    brake, push = 0.2 * 0.5 * 1300.0 / fastest, 0.2 * 1300.0 / fastest  # seconds to rest, and from rest
    for kind, expected in (("strike", 0.3 - brake), ("off", 0.45 + 0.4 + push)):
        for side, half in (("r", 0.0), ("l", 0.5)):
            found = np.array([event.times for event in events if (event.kind, event.side) == (kind, side)])
            wrong = (found - expected - half - late + 0.5) % 1.0 - 0.5
            assert len(found) >= 3 and np.abs(wrong).max() < 1e-9


def test_figures() -> None:
    walked = walk_draws(places(), NAMES, TIMES)
    found, told = _measures(walked, gait_events(walked))
    assert not told
    values = {(each.name, each.side): each.draws[0] for each in found}
    expected = {
        "stride time": PERIOD,
        "step time": PERIOD / 2,
        "stride length": 1.3 * PERIOD,
        "step length": 1.3 * PERIOD / 2,
        "step width": WIDTH / 1000,
        "stance": 100 * (STANCE - LATE / PERIOD),
    }
    for name, value in expected.items():
        for side in "lr":
            np.testing.assert_allclose(values[name, side], value, rtol=0.005, err_msg=name)
    np.testing.assert_allclose([values["cadence", ""], values["walking speed", ""]], [120 / PERIOD, 1.3], rtol=0.005)


def test_steps_of_different_length() -> None:
    """A right foot that strikes early by a tenth of a second makes its own step short, and the other's long."""
    late = places()
    for k, name in enumerate(NAMES):
        if name.endswith("_r") and not name.startswith("hip"):
            late[:, :-10, k] = late[:, 10:, k] - 130.0 * np.array([np.cos(0.4), np.sin(0.4), 0.0])
    walked = walk_draws(late[:, :-10], NAMES, TIMES[:-10])
    found, _ = _measures(walked, gait_events(walked))
    values = {(each.name, each.side): each.draws[0] for each in found}
    np.testing.assert_allclose([values["step time", side] for side in "rl"], [0.45, 0.65], atol=0.003)
    np.testing.assert_allclose([values["step length", side] for side in "rl"], [1.3 * 0.45, 1.3 * 0.65], atol=0.004)


def test_a_treadmill_has_no_lengths() -> None:
    walked = walk_draws(places(speed=0.0), NAMES, TIMES)
    found, told = _measures(walked, gait_events(walked))
    assert {each.name for each in found} == {"stride time", "step time", "stance", "cadence"} and "treadmill" in told[0]


def test_ankles_in_place_of_feet() -> None:
    walked = walk_draws(places(feet=False), NAMES[:4], TIMES)
    assert not walked.feet and sum(event.kind == "strike" for event in gait_events(walked)) >= 6


def test_angles_over_the_cycle() -> None:
    events = gait_events(walk_draws(places(), NAMES, TIMES))
    coordinates = [each for each in opensim_coordinates(full_body()) if each.name == "knee_angle_r"]
    angle = 30 + 20 * np.sin(2 * np.pi * (TIMES - STRIKES["r"] - LATE) / PERIOD)
    (cycle,) = _cycles(events, TIMES, coordinates, angle[None, :, None])
    assert cycle.side == "r" and cycle.number >= 3
    np.testing.assert_allclose(cycle.draws[0], 30 + 20 * np.sin(2 * np.pi * np.linspace(0, 1, 101)), atol=0.5)
    assert cycle.between.max() < 0.5


def test_what_is_no_walk() -> None:
    standing = places(speed=0.0)
    standing[:] = standing.mean(1, keepdims=True)
    with pytest.raises(InputError, match="no foot moves to and fro"):
        gait_events(walk_draws(standing, NAMES, TIMES))
    with pytest.raises(InputError, match="no ankle_l, ankle_r"):
        walk_draws(places()[:, :, :2], NAMES[:2], TIMES)
    with pytest.raises(InputError, match=r"50 frames in 0.49 s .expected frames in equal steps"):
        walk_draws(places()[:, :50], NAMES, TIMES[:50])
    with pytest.raises(InputError, match="level: 2"):
        quantiles(np.zeros((3, 2)), 2.0)


@pytest.mark.full
def test_a_result() -> None:
    states, _ = walk(30.0, 90)
    tree = drawn_result(states, np.full(states.shape[1], 1e-4), np.arange(90), 30.0, num_draws=5)
    with pytest.raises(InputError, match="draws are of single frames"):
        gait_of(tree)
    tree.attrs["joint"] = "true"
    found = gait_of(tree)
    values = {(each.name, each.side): each.draws.mean() for each in found.measures}
    assert 1.0 < values["walking speed", ""] < 1.4 and 100 < values["cadence", ""] < 120
    assert any(note.startswith("No camera found heels and toes") for note in found.notes)
    assert {"knee_angle_l", "knee_angle_r", "pelvis_tilt"} <= {cycle.name for cycle in found.cycles}
