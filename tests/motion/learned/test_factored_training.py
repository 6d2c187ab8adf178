"""Tables that are learned from one walk: its period, its phases, its steps."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.learned import bin_angles, read_factored_tables, train_factored_motion, write_factored_tables
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


@pytest.mark.full
def test_a_file_gives_back_the_tables(tmp_path):
    tables = trained(num_phases=3, num_bins=24)
    write_factored_tables(tables, tmp_path / "walk.nc")
    for one, other in zip(tables, read_factored_tables(tmp_path / "walk.nc"), strict=True):
        np.testing.assert_array_equal(one, other)
    write_factored_tables(tables._replace(phases=2 * tables.phases), tmp_path / "wrong.nc")
    with pytest.raises(InputError, match="phases"):
        read_factored_tables(tmp_path / "wrong.nc")
    (tmp_path / "none.nc").write_bytes(b"no file of ours")
    with pytest.raises(InputError):
        read_factored_tables(tmp_path / "none.nc")
