"""Sites whose samplers loop until they accept, drawn for all particles at once."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats

from poseppl.particles.keys import particle_keys
from poseppl.program import StateSpaceModel
from poseppl.program.population import draw_initial

REJECTED = {
    "von-Mises": (dist.VonMises(0.5, 2.0), stats.vonmises(2.0, loc=0.5)),
    "gamma": (dist.Gamma(0.5, 1.0), stats.gamma(0.5)),
    "beta": (dist.Beta(0.5, 2.0), stats.beta(0.5, 2.0)),
    "Student's t": (dist.StudentT(3.0), stats.t(3.0)),
    "binomial": (dist.Binomial(10, 0.7), stats.binom(10, 0.7)),
    "large binomial": (dist.Binomial(1000, 0.3), stats.binom(1000, 0.3)),
    "beta-binomial": (dist.BetaBinomial(2.0, 3.0, 10), stats.betabinom(10, 2.0, 3.0)),
    "negative binomial": (dist.NegativeBinomial2(5.0, 2.0), stats.nbinom(2.0, 2.0 / 7.0)),
    "Poisson": (dist.Poisson(4.0), stats.poisson(4.0)),
    "mixture": (
        dist.MixtureSameFamily(dist.Categorical(jnp.array([0.4, 0.6])), dist.VonMises(jnp.zeros(2), jnp.array([1.0, 20.0]))),
        SimpleNamespace(cdf=lambda x: 0.4 * stats.vonmises(1.0).cdf(x) + 0.6 * stats.vonmises(20.0).cdf(x)),
    ),
}
"""Sites that are drawn by loops of random length."""


@pytest.mark.parametrize(
    "name", ["von-Mises", *(pytest.param(name, marks=pytest.mark.full) for name in REJECTED if name != "von-Mises")]
)
def test_sites_that_are_drawn_by_rejection_have_their_distribution(name):
    distribution, exact = REJECTED[name]

    def initial(params, inputs):
        numpyro.sample("x", distribution)

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 1.0))

    model = StateSpaceModel(initial, lambda params, state, inputs: initial(params, inputs), observation).compile()
    number = 20_000
    flat = jax.jit(lambda key: draw_initial(model, particle_keys(key, number), None))(jax.random.key(0))
    draws = np.asarray(jax.vmap(model.to_sites)(flat)["x"])
    # of integers the distance is at most that of continuous draws (Dvoretzky, Kiefer and Wolfowitz): 2 exp(-2 n D^2) below 1e-4
    values = np.unique(draws)
    above = np.abs(np.searchsorted(np.sort(draws), values, side="right") / number - exact.cdf(values)).max()
    assert above < np.sqrt(np.log(2 / 1e-4) / (2 * number))
