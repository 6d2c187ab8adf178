"""Draws of a program's sites: independent, of their own laws, however they are computed."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from poseppl.particles.keys import particle_keys
from poseppl.program.execution import RngBudget, Seed, draw, trace_program

pytestmark = pytest.mark.full


def program() -> None:
    level = numpyro.sample("level", dist.Normal(2.0, 3.0))
    numpyro.sample("rate", dist.Exponential(2.0))
    numpyro.sample("pair", dist.Normal(level, jnp.array([0.1, 0.2])).to_event(1))
    numpyro.sample("side", dist.Bernoulli(0.5))
    numpyro.sample("several", dist.Normal(0.0, 1.0).expand([2]), sample_shape=(3,))


def test_randomness_is_counted():
    seed = Seed(jax.random.key(0), None)
    trace_program(program, (), seed=seed)
    assert seed.counted == RngBudget(num_keys=2, num_normals=1 + 2 + 6)


@pytest.mark.parametrize("split", [jax.random.split, particle_keys])
def test_normal_sites_draw_independent_numbers_of_their_own_law(split):
    number = 20_000
    drawn = jax.vmap(lambda key: draw(program, (), key, RngBudget(2, 9)))(split(jax.random.key(1), number))
    level = (drawn["level"] - 2.0) / 3.0
    pair = (drawn["pair"] - drawn["level"][:, None]) / jnp.array([0.1, 0.2])
    others = 2.0 * drawn["rate"] - 1.0, 2.0 * drawn["side"] - 1.0
    columns = np.column_stack([level, pair, drawn["several"].reshape(number, -1), *others])
    # five standard errors; the fourth moment of Exponential is 9
    np.testing.assert_allclose(columns.mean(0), 0.0, atol=5 / np.sqrt(number))
    np.testing.assert_allclose(np.cov(columns.T), np.eye(columns.shape[1]), atol=5 * np.sqrt(8 / number))


def test_a_program_of_one_normal_site_draws_with_its_key_unsplit():
    key = jax.random.key(3)
    drawn = draw(lambda: numpyro.sample("only", dist.Normal(2.0, 3.0).expand([5])), (), key, RngBudget(0, 5))
    np.testing.assert_array_equal(drawn["only"], 2.0 + 3.0 * jax.random.normal(key, (5,)))
