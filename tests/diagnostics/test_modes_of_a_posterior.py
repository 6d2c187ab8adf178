"""Modes of draws against the exact posterior of two mirror modes, and of a body whose arm may lean to either side."""

from __future__ import annotations

import numpy as np
import pytest
from poseppl_models.toys.mirror import LEVEL, NOISE, SPREAD, START, WIDTH

from poseppl.diagnostics import modes as module
from poseppl.diagnostics.modes import Ambiguity, ambiguities, mode_labels, modes_over_time
from poseppl.motion.tracking.body_result import BodyNames, body_result

DRAWS = 2000
MEAN = 5 * 0.5 / np.sqrt(0.1 * DRAWS)
"""Tolerance of the mean of a side: sides have standard deviations below 0.5, and a tenth of the draws or more."""
GRID = np.linspace(-8.0, 8.0, 801)
SEEN = np.array([3.0, 2.8, 3.3, 0.2, 3.1, 2.9, 3.2, 3.0])
"""Distances from 0 as they were seen: at the fourth frame the state is near 0, and may leave it to either side."""
SIDES = np.array([3.0, 2.8, 3.3, -1.0, np.nan, np.nan, np.nan, 3.0])
"""The observed state, where the side was observed."""
FIRST = 40


def exact_posteriors() -> np.ndarray:
    """Filtered probabilities (T, grid) of the mirror model, whose side is observed at some frames."""

    def normal(residual: np.ndarray, scale: float) -> np.ndarray:
        return np.exp(-0.5 * (residual / scale) ** 2)

    step = normal(GRID[:, None] - LEVEL * np.tanh(GRID / WIDTH), SPREAD)
    prediction, found = normal(GRID, START), []
    for seen, told in zip(SEEN, SIDES, strict=True):
        density = prediction * normal(seen - np.abs(GRID), NOISE) * (1.0 if np.isnan(told) else normal(told - GRID, NOISE))
        found.append(density / density.sum())
        prediction = step @ found[-1]
    return np.stack(found)


def result_of(states: np.ndarray, **more):
    """A result of weighted draws (N, T, d)."""
    frames = FIRST + np.arange(states.shape[1])
    return body_result(
        state=states[None], frames=frames, num_particles=len(states), **{"names": BodyNames(state_dim=("x",)), **more}
    )


@pytest.fixture(scope="module")
def mirror():
    exact, rng = exact_posteriors(), np.random.default_rng(0)
    states = np.stack([rng.choice(GRID, DRAWS, p=each) for each in exact], 1)
    return exact, result_of(states[..., None])


def test_modes_have_the_exact_probabilities_of_their_sides(mirror) -> None:
    exact, tree = mirror
    modes = modes_over_time(tree)
    positive = exact[:, GRID > 0].sum(1)
    two = np.minimum(positive, 1 - positive) > 2 * module.MIN_SHARE
    two[3] = False  # near 0 both sides are one mode
    assert two.tolist() == [False] * 4 + [True] * 3 + [False]
    np.testing.assert_array_equal((modes.masses > 0).sum(1) == 2, two)
    greater = np.maximum(positive, 1 - positive)[two]
    tolerance = 5 * np.sqrt(greater * (1 - greater) / DRAWS).max()
    np.testing.assert_allclose(modes.masses[two, 0], greater, atol=tolerance)
    for frame in np.flatnonzero(two):
        sides = [exact[frame] * (GRID > 0), exact[frame] * (GRID < 0)]
        means = [float(GRID @ side / side.sum()) for side in sorted(sides, key=lambda side: -side.sum())]
        np.testing.assert_allclose(modes.means[frame, :2, 0], means, atol=MEAN)
    np.testing.assert_allclose(modes.masses.sum(1), 1.0)


def test_an_ambiguity_arises_and_is_resolved_when_the_side_is_observed(mirror) -> None:
    exact, tree = mirror
    (found,) = ambiguities(modes_over_time(tree))
    assert found._replace(lesser=0, apart=0) == Ambiguity(FIRST + 4, FIRST + 7, 0, "x", 0)
    lesser = np.minimum(*(exact[4:7, side].sum(1) for side in (GRID > 0, GRID < 0)))
    assert found.lesser == pytest.approx(lesser.max(), abs=5 * 0.5 / np.sqrt(DRAWS))
    density = exact[4 + int(lesser.argmax())]
    apart = np.subtract(*(GRID[side] @ density[side] / density[side].sum() for side in (GRID > 0, GRID < 0)))
    assert found.apart == pytest.approx(apart, abs=MEAN)
    (unresolved,) = ambiguities(modes_over_time(tree, np.arange(7)))
    assert unresolved.resolved is None and unresolved.arose == FIRST + 4


def test_halves_of_one_mode_are_not_two(mirror, monkeypatch) -> None:
    """A bound below 2.65 divides normal distributions, and finds modes where the exact posterior has one."""
    monkeypatch.setattr(module, "MIN_APART", 2.0)
    assert (modes_over_time(mirror[1]).masses[:3] > 0).sum(1).max() > 1


def test_draws_of_one_mode_are_one_in_many_dimensions() -> None:
    """Chains that mix slowly, heavy tails, few draws, and draws that are not finite."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        noise = rng.normal(size=(20, 30, 51))
        chains = np.stack([noise[:10].sum(0) / 10**0.5, noise[5:15].sum(0) / 10**0.5, noise[10:].sum(0) / 10**0.5])
        assert mode_labels((chains * np.exp(-np.arange(51) / 10)).reshape(-1, 51)).max() == 0
        assert mode_labels(rng.standard_t(4, (600, 3)) * [3, 2, 1]).max() == 0
    assert mode_labels(np.repeat([0.0, 1.0], 9)[:, None]).max() == 0
    assert mode_labels(np.repeat([0.0, 1.0], 10)[:, None]).max() == 1
    assert mode_labels(np.full((40, 2), np.nan)).max() == 0
    assert mode_labels(np.zeros((1, 2))).tolist() == [0]


def test_modes_of_two_limbs_are_distinguished_with_their_places() -> None:
    rng = np.random.default_rng(2)
    places = np.tile([[0.0, 0.0, 900.0], [200.0, 0.0, 1100.0], [-200.0, 0.0, 1100.0]], (1000, 1, 1))
    right, left = np.split(rng.uniform(size=(2, 1000)), 2)
    places[:, 1, 1] = np.where(right[0] < 0.7, -150.0, 150.0)
    places[:, 2, 1] = np.where(left[0] < 0.2, -250.0, 250.0)
    places += rng.normal(scale=20.0, size=places.shape)
    names = BodyNames(state_dim=("x",), marker=("pelvis", "wrist_r", "wrist_l"))
    tree = result_of(np.zeros((1000, 1, 1)), extras={"markers": places[None, :, None]}, names=names)
    modes = modes_over_time(tree, of="markers")
    np.testing.assert_allclose(modes.masses[0], [0.56, 0.24, 0.14, 0.06], atol=5 * np.sqrt(0.25 / 1000))
    expected = [(-150, 250), (150, 250), (-150, -250), (150, -250)]
    np.testing.assert_allclose(modes.means[0, :, 1:, 1], expected, atol=5 * 20 / np.sqrt(40))
    (found,) = ambiguities(modes)
    assert (found.place, found.resolved) == ("wrist_r", None) and found.apart == pytest.approx(300, abs=20)
    assert found.lesser == pytest.approx(0.44, abs=5 * 0.5 / np.sqrt(1000))
