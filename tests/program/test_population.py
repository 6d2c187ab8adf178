"""A population's functions against a loop over its particles."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import frame, problem

from poseppl.program import population

POSED = problem()
MODEL, INPUTS, OBSERVATION = POSED.model, POSED.inputs[1], frame(POSED.observations, 1)
XS, BEFORE = jax.random.normal(jax.random.key(0), (2, 4, 2))
KEYS = jax.random.split(jax.random.key(1), 4)

MATRIX = [[MODEL.log_transition(x, before, INPUTS) for before in BEFORE] for x in XS]
CASES = {
    "draw_initial": ((KEYS,), [MODEL.sample_initial(key, INPUTS) for key in KEYS]),
    "propagate": ((KEYS, BEFORE), [MODEL.sample_transition(key, x, INPUTS) for key, x in zip(KEYS, BEFORE, strict=True)]),
    "log_likelihoods": ((XS, OBSERVATION), [MODEL.log_observation(x, OBSERVATION, INPUTS) for x in XS]),
    "log_initials": ((XS,), [MODEL.log_initial(x, INPUTS) for x in XS]),
    "log_transitions": ((XS, BEFORE), [MATRIX[i][i] for i in range(4)]),
    "log_transitions_into": ((XS[2], BEFORE), MATRIX[2]),
    "log_transition_matrix": ((XS[:3], BEFORE), MATRIX[:3]),
    "log_prediction": ((XS[0], BEFORE), jnp.log(jnp.mean(jnp.exp(jnp.asarray(MATRIX[0]))))),
}


@pytest.mark.parametrize("name", CASES)
def test_the_population_is_its_particles(name):
    arguments, expected = CASES[name]
    found = getattr(population, name)(MODEL, *arguments, INPUTS)
    np.testing.assert_allclose(found, np.asarray(expected), rtol=1e-5)


@pytest.mark.full
def test_moments_are_those_of_each_particle():
    means, covariances = population.transition_moments(MODEL, BEFORE, INPUTS)
    for found_mean, found_covariance, x in zip(means, covariances, BEFORE, strict=True):
        mean, covariance = MODEL.transition_moments(x, INPUTS)
        np.testing.assert_allclose(found_mean, mean, rtol=1e-5)
        np.testing.assert_allclose(found_covariance, covariance, rtol=1e-5)
