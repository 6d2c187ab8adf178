"""Statements of docs/validation/errata.md about the papers' formulas, worked out on small examples."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_choo_fleet_equation_7(dimension):
    """Binomial(N, p) of N draws from the prior fall into the posterior; means of this number have the variance of Eq. 7."""
    share, number = 0.2**dimension, 20_000
    hits = np.arange(1, number + 1)
    chance = stats.binom.pmf(hits, number, share)
    inefficiency = number * np.sum(chance / hits) / chance.sum()  # times Var[f] / N
    assert inefficiency == pytest.approx(1 / share, rel=0.02)
    assert np.sum(chance * hits) == pytest.approx(number * share)  # the effective number, which falls with the dimension
    assert stats.binom.pmf(0, round(1 / share), share) < 0.4  # (prior / posterior) draws: one is expected to hit


def test_choo_fleet_volumes_are_square_roots_of_variances():
    prior, posterior = np.diag([4.0, 9.0, 25.0]), np.diag([1.0, 0.25, 4.0])
    volumes = [np.sqrt(np.linalg.det(each)) for each in (prior, posterior)]  # times that of the unit ball
    variances = [np.prod(np.diag(each)) for each in (prior, posterior)]
    assert variances[0] / variances[1] == pytest.approx((volumes[0] / volumes[1]) ** 2)


def gradient(s: np.ndarray) -> np.ndarray:
    """An energy with a coupling and a quartic part."""
    return np.array([3.0 * s[0] + 0.5 * s[1] + s[0] ** 3, 0.5 * s[0] + 0.2 * s[1]])


def leapfrog(s: np.ndarray, p: np.ndarray, steps: np.ndarray, masses: np.ndarray) -> np.ndarray:
    for _ in range(5):
        p = p - steps / 2 * gradient(s)
        s = s + steps * p / masses
        p = p - steps / 2 * gradient(s)
    return s


def test_choo_fleet_masses_are_inverse_squares_of_step_sizes():
    s, p, step, own = np.array([0.3, -1.0]), np.array([0.5, 0.8]), 0.1, np.array([0.05, 0.3])
    expected = leapfrog(s, p, own, np.ones(2))
    masses = step**2 / own**2
    np.testing.assert_allclose(leapfrog(s, np.sqrt(masses) * p, np.full(2, step), masses), expected, rtol=1e-12)
    printed = own**2 / step**2
    assert np.abs(leapfrog(s, np.sqrt(printed) * p, np.full(2, step), printed) - expected).max() > 0.1


def test_sminchisescu_triggs_gradient_has_the_other_sign():
    weight, seen, strength = np.array([[2.0, 0.3], [0.3, 1.0]]), np.array([0.4, -0.2]), 1.5

    def predicted(x):
        return np.array([np.sin(x[0]) + x[1], x[0] * x[1]])

    def cost(x):
        apart = seen - predicted(x)
        return 0.5 * strength * np.log1p(apart @ weight @ apart / strength)

    x, small = np.array([0.7, 0.5]), 1e-6
    found = np.array([(cost(x + small * e) - cost(x - small * e)) / (2 * small) for e in np.eye(2)])
    apart, jacobian = seen - predicted(x), np.array([[np.cos(x[0]), 1.0], [x[1], x[0]]])
    printed = jacobian.T @ weight @ apart / (1 + apart @ weight @ apart / strength)
    np.testing.assert_allclose(found, -printed, rtol=1e-6)


def test_du_guan_equation_7_grows_with_survival():
    alike, one = np.full(10, 0.1), np.eye(10)[0]
    assert 1 / np.sum(alike**2) == pytest.approx(10) and 1 / np.sum(one**2) == 1


def chain(density: np.ndarray, together: bool) -> np.ndarray:
    """Transition matrix of three members' update by Eq. 6 with lambda = 1 on a ring, all at once or one after the other."""
    size = len(density)
    states = list(itertools.product(range(size), repeat=3))
    noise = {-1: 0.1, 0: 0.8, 1: 0.1}

    def moves(state, n):
        """Probabilities of the next place of member n."""
        others = [state[m] for m in range(3) if m != n]
        row = np.zeros(size)
        for (first, second), (shake, chance) in itertools.product((others, others[::-1]), noise.items()):
            place = (state[n] + first - second + shake) % size
            accept = min(1.0, density[place] / density[state[n]])
            row[place] += chance / 2 * accept
            row[state[n]] += chance / 2 * (1 - accept)
        return row

    def matrix(members):
        rows = np.zeros((len(states), len(states)))
        for number, state in enumerate(states):
            own = [moves(state, n) if n in members else np.eye(size)[state[n]] for n in range(3)]
            rows[number] = np.einsum("i,j,k->ijk", *own).ravel()
        return rows

    return matrix((0, 1, 2)) if together else matrix((0,)) @ matrix((1,)) @ matrix((2,))


def test_du_guan_members_that_move_together_do_not_keep_the_density():
    density = np.array([0.1, 0.2, 0.5, 0.15, 0.05])
    product = np.einsum("i,j,k->ijk", *[density] * 3).ravel()
    np.testing.assert_allclose(product @ chain(density, False), product, atol=1e-12)
    assert np.abs(product @ chain(density, True) - product).sum() > 0.01


def test_du_guan_a_frame_costs_a_population_more():
    assert [(layers + 1) * members for layers, members in ((7, 500), (5, 700), (2, 1750))] == [4000, 4200, 5250]


def test_peursum_equation_23b_is_no_variance():
    weights, places = np.array([0.25, 0.75]), np.array([1000.0, 3000.0])
    mean = weights @ places
    assert weights @ places**2 - mean**2 == pytest.approx(weights @ (places - mean) ** 2)
    assert np.sum((weights * places) ** 2) - mean**2 < 0
    alike = np.full(8, 2000.0)
    assert np.sum((alike / 8) ** 2) - 2000.0**2 == pytest.approx(-(1 - 1 / 8) * 2000.0**2)


def test_peursum_equation_19_adds_up_to_one_nth():
    rng = np.random.default_rng(0)
    rho, shares = rng.random(6), rng.dirichlet(np.ones(3), 6)
    printed = (rho[:, None] * shares).sum(0) / (6 * rho.sum())
    assert printed.sum() == pytest.approx(1 / 6)
