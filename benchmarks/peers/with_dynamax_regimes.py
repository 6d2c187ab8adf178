"""The job of regimes in dynamax: expectation maximisation."""

import jax
import jax.numpy as jnp
from dynamax.hidden_markov_model import LinearAutoregressiveHMM
from job_regimes import START

NAME, PACKAGE, METHOD, JOB = "dynamax", "dynamax", "expectation maximisation", "job_regimes"


def prepare(data):
    jax.config.update("jax_enable_x64", True)
    model = LinearAutoregressiveHMM(2, 1, transition_matrix_concentration=1.0)
    params, props = model.initialize(
        initial_probs=jnp.array([0.5, 0.5]),
        transition_matrix=jnp.array([[START[0], 1 - START[0]], [1 - START[1], START[1]]]),
        emission_weights=jnp.array(START[2:4, None, None]),
        emission_biases=jnp.array(START[4:6, None]),
        emission_covariances=jnp.array(START[6:, None, None] ** 2),
    )
    props.initial.probs.trainable = False
    emissions = jnp.asarray(data)[:, None]
    before = model.compute_inputs(emissions)

    def run(seed):
        found, _ = model.fit_em(params, props, emissions, before, num_iters=100, verbose=False)
        stay, (weights, biases, covs) = jnp.diag(found.transitions.transition_matrix), found.emissions
        return jnp.concatenate([stay, weights[:, 0, 0], biases[:, 0], jnp.sqrt(covs[:, 0, 0])])

    return run
