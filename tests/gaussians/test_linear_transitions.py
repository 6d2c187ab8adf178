"""The prior of a trajectory as a Gaussian, against derivatives of the model's own log-density."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

from poseppl.gaussians.block_tridiagonal import to_dense
from poseppl.gaussians.linear_transitions import linear_transitions, quadratic_prior


@pytest.mark.full
@pytest.mark.parametrize("frames", [1, 4])
def test_a_linear_prior_has_its_hessian_and_gradient(frames):
    """A transition that is not symmetric, at states that are not its mean."""
    matrices = linear_gaussian_matrices(2, A=[[0.9, 0.5], [-0.3, 0.7]], Q=[[0.3, 0.1], [0.1, 0.2]], m=[1.0, -2.0])
    model = linear_gaussian_model(matrices).compile()
    states = jnp.asarray(np.random.default_rng(0).normal(size=(frames, 2)))

    def log_prior(flat):
        xs = flat.reshape(frames, 2)
        return model.log_initial(xs[0]) + sum(model.log_transition(xs[t], xs[t - 1]) for t in range(1, frames))

    precision, gradient = quadratic_prior(linear_transitions(model, states, None), states)
    np.testing.assert_allclose(to_dense(precision), -jax.hessian(log_prior)(states.ravel()), atol=1e-3)
    np.testing.assert_allclose(gradient.ravel(), jax.grad(log_prior)(states.ravel()), rtol=1e-3, atol=1e-3)
