"""Tables that are learned from one walk: its period, its phases, its steps."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.learned import (
    PosedRecording,
    bin_angles,
    learn_factored_motion,
    read_factored_motion,
    read_learned_motion,
    train_factored_motion,
    write_factored_motion,
)
from poseppl.motion.learned.factored_tables import bins_of, phases_of

COORDINATES = [("root", "tx"), ("root", "ty"), ("root", "tz"), ("root", "Z"), ("hip", "X"), ("knee", "X")]
RATE, PERIOD = 50.0, 50


def a_walk(periods: float = 3.0, heading: float = 0.0) -> np.ndarray:
    """Poses (T, 6) of legs that swing, 20 mm a frame ahead, past the turn where angles wrap."""
    cycle = 2 * np.pi * np.arange(int(periods * PERIOD)) / PERIOD
    along = 20.0 * np.arange(len(cycle))
    place = np.stack([-np.sin(heading) * along, np.cos(heading) * along, np.full(len(cycle), 900.0)], 1)
    return np.column_stack([place, np.full(len(cycle), heading), np.pi + 0.5 * np.sin(cycle), 0.4 * np.cos(cycle) - 0.4])


def trained(**settings):
    return train_factored_motion(a_walk(), COORDINATES, RATE, **settings)


def test_phases_are_equal_parts_of_the_period():
    phases = phases_of(a_walk()[:, 4:], RATE, 5)
    np.testing.assert_array_equal(phases, np.arange(150) % PERIOD // 10)
    with pytest.raises(InputError, match="two periods"):
        phases_of(a_walk(1.0)[:, 4:], RATE, 5)


def test_probabilities():
    tables = trained(num_phases=5)
    goes_on = np.array([3 / 30, 3 / 30, 3 / 30, 3 / 30, 2 / 29])  # the last frame has no next one
    expected = np.diag(1 - goes_on) + np.roll(np.diag(goes_on), 1, axis=1)
    np.testing.assert_allclose(tables.phases, expected, atol=1e-6)
    np.testing.assert_allclose(tables.first_phase, 0.2, atol=1e-6)
    for rows in (tables.first_bins, tables.entries):
        np.testing.assert_allclose(np.sum(rows, -1), 1.0, atol=1e-5)
    total = np.sum(tables.steps, -1)
    assert np.all((np.abs(total - 1) < 1e-5) | (total == 0)) and 0.5 < np.mean(total == 0) < 1


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_velocities_are_ahead_whatever_the_heading(heading):
    tables = train_factored_motion(a_walk(heading=heading), COORDINATES, RATE)
    np.testing.assert_allclose(tables.velocities, np.broadcast_to([20.0 * RATE, 0.0, 0.0], (8, 3)), atol=0.05)


def test_velocities_do_not_depend_on_the_rate_of_the_recording():
    every_second = train_factored_motion(a_walk()[::2], COORDINATES, RATE / 2)
    np.testing.assert_allclose(every_second.velocities, trained().velocities, atol=0.05)


@pytest.mark.full
@pytest.mark.parametrize("degrees", [2.0, 6.0])
def test_a_phase_is_entered_where_the_walk_is_in_it(degrees):
    tables, walk = trained(num_phases=5, spread=np.radians(degrees)), a_walk()[:, 4:]
    phases, angles = phases_of(walk, RATE, 5), np.asarray(bin_angles(np.arange(120)))
    for phase in range(5):
        recorded = walk[1:][phases[1:] == phase]
        for rotation in range(2):
            share = np.asarray(tables.entries[phase, rotation], np.float64)
            apart = (angles[:, None] - recorded[:, rotation] + np.pi) % (2 * np.pi) - np.pi
            assert abs(np.degrees(share @ apart.mean(1))) < 0.2
            spread = np.sqrt(share @ np.square(apart).mean(1))
            inside = np.sqrt(np.var(recorded[:, rotation]) * 2 + np.radians(degrees) ** 2)
            np.testing.assert_allclose(spread, inside, rtol=0.02)


@pytest.mark.full
def test_who_walks_by_the_tables_stays_with_the_walk():
    """The mean of the next angle is that of the recording's next frame, and drawn walks stay within three spreads of it."""
    tables, walk = trained(), a_walk()[:, 4:]
    phases, rng = phases_of(walk, RATE, 8), np.random.default_rng(0)
    bins = bins_of(walk[0])
    apart = []
    for frame in range(1, len(walk)):
        rows = np.asarray(tables.successors(jnp.asarray(phases[frame]), jnp.asarray(bins)), np.float64)
        bins = np.array([rng.choice(120, p=row / row.sum()) for row in rows])
        apart.append(np.asarray(bin_angles(bins)) - walk[frame])
    apart = np.abs((np.array(apart) + np.pi) % (2 * np.pi) - np.pi)
    assert np.degrees(np.sqrt(np.mean(apart**2))) < 12.0 and np.degrees(apart.max()) < 40.0


def recorded(**settings):
    names = tuple(f"{joint}.{axis}" for joint, axis in COORDINATES)
    return learn_factored_motion(PosedRecording(a_walk(), names, "root", RATE, "she", "walk.amc", 1.5), "a:body", **settings)


def test_steps_of_the_root_are_about_the_stride():
    """This body walks evenly: beside its stride nothing is left."""
    np.testing.assert_allclose(recorded().step_scale, 1e-6, atol=2e-3)
    names = tuple(f"{joint}.{axis}" for joint, axis in COORDINATES)
    rng = np.random.default_rng(0)
    shaken = a_walk(6.0)
    shaken[:, :4] += np.cumsum(rng.normal(size=(len(shaken), 4)) * [3.0, 3.0, 2.0, 0.01], 0)
    found = learn_factored_motion(PosedRecording(shaken, names, "root", RATE, "she", "walk.amc", 1.5), "a:body").step_scale
    np.testing.assert_allclose(found, [3.0, 3.0, 2.0, 0.01], rtol=0.2)


def test_a_file_gives_back_the_walk(tmp_path):
    walk = recorded(num_phases=3)
    write_factored_motion(walk, tmp_path / "walk.nc")
    again = read_learned_motion(tmp_path / "walk.nc")
    for one, other in zip(walk.tables, again.tables, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(again.step_scale, walk.step_scale)
    assert again._replace(tables=None, step_scale=None) == walk._replace(tables=None, step_scale=None)
    (tmp_path / "none.nc").write_bytes(b"no file of ours")
    with pytest.raises(InputError):
        read_factored_motion(tmp_path / "none.nc")


@pytest.mark.parametrize(
    ("words", "tables", "others"),
    [
        ("phases", {"phases": lambda rows: 2 * rows}, {}),
        ("steps", {"steps": lambda rows: rows[..., :-1]}, {}),
        ("stays", {"stays": lambda stays: 1.5}, {}),
        ("step_scale", {}, {"step_scale": np.zeros(4)}),
        ("5 coordinates", {}, {"coordinates": ("a", "b", "c", "d", "e")}),
        ("frames a second", {}, {"rate": np.nan}),
    ],
)
def test_a_file_with_other_contents_is_refused(tmp_path, words, tables, others):
    walk = recorded(num_phases=3)
    wrong = {name: change(getattr(walk.tables, name)) for name, change in tables.items()}
    write_factored_motion(walk._replace(tables=walk.tables._replace(**wrong), **others), tmp_path / "wrong.nc")
    with pytest.raises(InputError, match=words):
        read_factored_motion(tmp_path / "wrong.nc")


def test_a_body_without_a_heading_is_refused():
    names = tuple(f"{joint}.{axis}" for joint, axis in COORDINATES if axis != "Z")
    poses = np.delete(a_walk(), 3, axis=1)
    with pytest.raises(InputError, match="vertical"):
        learn_factored_motion(PosedRecording(poses, names, "root", RATE, "she", "walk.amc", 1.5), "a:body")
