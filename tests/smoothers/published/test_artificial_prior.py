"""The Gaussians that a backward filter is led by, against conditional moments of a Gaussian."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import multivariate_normal

from poseppl.smoothers.published.two_filter import summarise

INFLATION = 1.5


def test_a_state_given_its_successor_has_the_moments_of_a_joint_gaussian():
    """Two coordinates each; the remaining variances are inflated, and so is the prior."""
    rng = np.random.default_rng(0)
    root, mean = rng.normal(size=(4, 4)), rng.normal(size=4)
    joint = root @ root.T + 0.5 * np.eye(4)
    prior, regression = summarise(jnp.asarray(mean), jnp.asarray(joint), INFLATION)
    successors = rng.normal(size=(5, 2))
    exact = multivariate_normal(mean[2:], INFLATION * joint[2:, 2:])
    np.testing.assert_allclose(prior.log_density(jnp.asarray(successors)), exact.logpdf(successors), rtol=1e-3)
    gain = joint[:2, 2:] @ np.linalg.inv(joint[2:, 2:])
    left = INFLATION * (joint[:2, :2] - gain @ joint[2:, :2])
    number = 20_000
    for successor in successors[:2]:
        drawn, log_density = regression.draw(jax.random.key(1), jnp.broadcast_to(successor, (number, 2)))
        centre = mean[:2] + gain @ (successor - mean[2:])
        np.testing.assert_allclose(
            log_density, multivariate_normal(centre, left).logpdf(drawn), rtol=1e-2, atol=0.05
        )  # a small diagonal is added
        spread = np.sqrt(np.diag(left) / number)
        assert (np.abs(np.asarray(drawn).mean(0) - centre) < 5 * spread).all()
