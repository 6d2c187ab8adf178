r"""Gaussian proposals from a local linearisation of the model by automatic differentiation.

Let x' be the previous state, \mu = E[x_t | x'] and Q = Cov[x_t | x']. Let I be the curvature of -log p(z_t | x) and g = d/dx
log p(z_t | x) its gradient, both at \mu. The proposal and its predictive likelihood are

    q(x_t | x') = N(\mu + C g, C),    C = (Q^-1 + I)^-1,
    log p(z_t | x') ~ log p(z_t | \mu) + g^T C g / 2 - log |1 + Q I| / 2

(Doucet, Godsill and Andrieu 2000, doi:10.1023/A:1008935410038, section II-D). For linear Gaussian programs these are the
optimal proposal and the exact predictive likelihood. If neither Q nor I depends on the state, which is read from the
traced programs, one factorisation serves all particles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import lower_inverse
from poseppl.particles.keys import particle_keys
from poseppl.program import CompiledModel, Observation
from poseppl.program.dependence import output_dependence

Moments = Callable[[Array], tuple[Array, Array]]


class LocalProposal(NamedTuple):
    """Proposals of N particles.

    Attributes:
        means: Shape (N, d).
        scales: Square roots S of the covariances, C = S S^T: (N, d, d), or (d, d) for all.
        log_predictive: Approximate log p(z_t | x') (N,), finite.
        log_det: log |S|, (N,) or a scalar.
    """

    means: Array
    scales: Array
    log_predictive: Array
    log_det: Array

    def draw(self, rng_key: Array, ancestors: Array) -> tuple[Array, Array]:
        """Draw states (N, d) around the means of the ancestors (N,), and their log-densities (N,)."""
        means = self.means[ancestors]
        keys = particle_keys(rng_key, means.shape[0])
        noise = jax.vmap(lambda key: jax.random.normal(key, means.shape[1:], means.dtype))(keys)
        if self.scales.ndim == 2:
            offset, log_det = noise @ self.scales.T, self.log_det
        else:
            offset, log_det = jnp.einsum("nij,nj->ni", self.scales[ancestors], noise), self.log_det[ancestors]
        constant = 0.5 * means.shape[1] * jnp.log(2 * jnp.pi)
        return means + offset, -0.5 * jnp.sum(noise**2, 1) - log_det - constant


def local_proposal(
    model: CompiledModel, moments: Moments, previous: Array, observation: Observation, inputs: Any
) -> LocalProposal:
    """Linearise around the predictions of N particles.

    Args:
        model: The compiled model.
        moments: Mean (d,) and covariance (d, d) of the state given the one before.
        previous: States before (N, d); a single one, of any value, at the first frame, whose moments do not depend on it.
        observation: The frame's data.
        inputs: The frame's inputs.
    """
    means = jax.vmap(lambda x: moments(x)[0])(previous)
    log_likelihood, gradients = jax.vmap(jax.value_and_grad(lambda x: model.log_observation(x, observation, inputs)))(means)
    usable = jnp.isfinite(log_likelihood) & jnp.all(jnp.isfinite(gradients), 1)
    gradients = jnp.where(usable[:, None], gradients, 0.0)

    def scale_of(before: Array, at: Array) -> tuple[Array, Array, Array]:
        return _scale(moments(before)[1], model.observation_information(at, observation, inputs))

    if _is_constant(lambda x: (moments(x)[1], model.observation_information(x, observation, inputs)), means[0]):
        scales, log_det, half_log_ratio = scale_of(previous[0], means[0])
        shifts = gradients @ (scales @ scales.T)
    else:
        scales, log_det, half_log_ratio = jax.vmap(scale_of)(previous, means)
        shifts = jnp.einsum("nij,nj->ni", scales, jnp.einsum("nij,ni->nj", scales, gradients))
    log_predictive = log_likelihood + 0.5 * jnp.sum(gradients * shifts, 1) - half_log_ratio
    return LocalProposal(means + shifts, scales, _finite(jnp.where(usable, log_predictive, -jnp.inf)), log_det)


def _scale(covariance: Array, information: Array) -> tuple[Array, Array, Array]:
    """Square root S of (Q^-1 + I)^-1, its log-determinant, and log |1 + Q I| / 2.

    An information that is not finite is left out: the proposal is then the prediction.
    """
    information = jnp.where(jnp.all(jnp.isfinite(information)), information, 0.0)
    lower = jnp.linalg.cholesky(covariance)
    eye = jnp.eye(lower.shape[0], dtype=lower.dtype)
    factor = jnp.linalg.cholesky(eye + lower.T @ information @ lower)
    scale = lower @ lower_inverse(factor).T
    half_log_ratio = jnp.sum(jnp.log(jnp.diagonal(factor)))
    return scale, jnp.sum(jnp.log(jnp.diagonal(lower))) - half_log_ratio, half_log_ratio


def _is_constant(function: Callable[[Array], Any], x: Array) -> bool:
    closed = jax.make_jaxpr(lambda x: jax.tree.leaves(function(x)))(x)
    return not any(output_dependence(closed, [frozenset({0})]))


def _finite(log_predictive: Array) -> Array:
    """The values with the least finite one in place of those that are not; zeros where none is."""
    finite = jnp.isfinite(log_predictive)
    least = jnp.min(jnp.where(finite, log_predictive, jnp.inf))
    return jnp.where(finite, log_predictive, jnp.where(jnp.isfinite(least), least, 0.0))
