"""Operations of a mode tracker on a mixture of Gaussians: predict it, take it for a prior, start from it, draw from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.gaussians.gaussian import Gaussian, precision_of
from poseppl.gaussians.linearisation import linearise, predict
from poseppl.gaussians.mixture import GaussianMixture, factorise_mixture, log_mixture, log_mixture_terms, mixture_curvature
from poseppl.kernels import face_laplace
from poseppl.kernels.constraints import Constraints
from poseppl.kernels.face_laplace import FaceModes
from poseppl.kernels.mode_search import ModeProposal
from poseppl.kernels.trust_region import Curvature, LogDensity
from poseppl.particles.resampling import systematic
from poseppl.program import CompiledModel

_EVENNESS = 0.5
"""Starts are shared among modes in proportion to this power of their weights: a lesser mode gets more than its share."""


def predicted_modes(model: CompiledModel, modes: GaussianMixture, first: Array, inputs: Any) -> tuple[GaussianMixture, Array]:
    """The prior of a frame, and the dynamical noise (d, d) at its best mode; both of the initial program at the first one."""

    def move(mean: Array, covariance: Array) -> tuple[Gaussian, Array]:
        past = Gaussian(mean, covariance)
        linear = linearise(lambda x: model.transition_moments(x, inputs), past, "first-order")
        return predict(past, linear), linear.noise

    moved, noises = jax.vmap(move)(modes.means, modes.covariances)
    mean, covariance = model.initial_moments(inputs)
    alone = jnp.where(jnp.arange(len(modes.log_weights)) == 0, 0.0, -jnp.inf).astype(mean.dtype)
    return (
        GaussianMixture(
            jnp.where(first, alone, modes.log_weights),
            jnp.where(first, mean, moved.mean),
            jnp.where(first, covariance, moved.covariance),
        ),
        jnp.where(first, covariance, noises[jnp.argmax(modes.log_weights)]),
    )


def prior_density(modes: GaussianMixture, *, closest: bool) -> tuple[LogDensity, Curvature]:
    """The log-density of one state under the modes of the prior, and a curvature of it that is positive definite.

    Args:
        modes: The modes.
        closest: Whether the most probable mode at a state counts alone, or all together.
    """
    factors = factorise_mixture(modes)
    if not closest:
        return log_mixture(modes, factors), mixture_curvature(modes, factors)
    terms, precisions = log_mixture_terms(modes, factors), jax.vmap(precision_of)(modes.covariances)
    return lambda x: jnp.max(terms(x)), lambda x: precisions[jnp.argmax(terms(x))]


def mode_starts(
    rng_key: Array,
    modes: GaussianMixture,
    num_starts: int,
    proposal: Callable[[int], ModeProposal],
    jumps: Callable[[Array], Array] | None,
) -> Array:
    """Starts (S, d) of climbs: the means of all K modes, then what each proposes, by the modes' weights.

    Args:
        rng_key: PRNG key.
        modes: The modes.
        num_starts: S, at least K.
        proposal: A proposal of so many starts.
        jumps: Other states (n, d) of a mean; every second start of a mode is one of them.
    """
    number = num_starts - len(modes.log_weights)
    if not number:
        return modes.means
    key_share, key_propose = jax.random.split(rng_key)
    keys = jax.random.split(key_propose, len(modes.log_weights))
    proposed = jax.vmap(proposal(number))(keys, modes.means, modes.covariances)
    if jumps is not None:
        jumped = jax.vmap(jumps)(modes.means)
        turn = np.arange(number)
        proposed = jnp.where((turn % 2 == 0)[:, None], jumped[:, turn // 2 % jumped.shape[1]], proposed[:, turn // 2])
    chosen = systematic(key_share, _EVENNESS * modes.log_weights, number)
    rank = jnp.sum((chosen[:, None] == chosen) & (jnp.arange(number)[:, None] > jnp.arange(number)), 1)
    return jnp.concatenate([modes.means, proposed[chosen, rank]])


def draw_modes(
    rng_key: Array,
    modes: GaussianMixture,
    num_draws: int,
    constraints: Constraints | None,
    found: FaceModes,
    failed: Array,
) -> Array:
    """Draws (N, d) from modes, each by its weight: of those on a constraint inside of it, of others folded back at the bounds.

    Args:
        rng_key: PRNG key.
        modes: The modes as Gaussians.
        num_draws: N.
        constraints: Constraints of the states; None where there are no bounds and no rows.
        found: The modes under the constraints.
        failed: Whether `modes` is another mixture, a prediction.
    """
    key_mode, key_noise, key_cut = jax.random.split(rng_key, 3)
    chosen = systematic(key_mode, modes.log_weights, num_draws)
    noise = jax.random.normal(key_noise, (num_draws, modes.means.shape[1]), modes.means.dtype)
    unit = jnp.sqrt(jnp.diagonal(modes.covariances, axis1=1, axis2=2))
    lower = unit[..., None] * jnp.linalg.cholesky(modes.covariances / unit[..., None] / unit[:, None])
    draws = modes.means[chosen] + jnp.einsum("nij,nj->ni", lower[chosen], noise)
    if constraints is None:
        return draws
    inside = _draw_inside(key_cut, found, constraints, noise, chosen)
    cut = jnp.any(found.active, 1)[chosen] & ~failed
    return _folded(jnp.where(cut[:, None], inside, draws), constraints)


def _draw_inside(rng_key: Array, found: FaceModes, constraints: Constraints, noise: Array, chosen: Array) -> Array:
    """Draws (N, d) on the free face, moved inside by a draw of the distance from each active constraint."""
    offset = jnp.einsum("nij,nj->ni", found.scales[chosen], noise)
    # what the Gaussian has of each distance is taken away, and that of the cut density put in its place
    normals = jax.vmap(constraints.normals)(found.states) * found.active[..., None]
    distance = -jnp.einsum("nij,nj->ni", normals[chosen], offset)
    cut = face_laplace.draw(rng_key, found.slopes[chosen], found.inner_curvatures[chosen], 1)[0]
    inward = jnp.where(found.active[chosen], cut - distance, 0.0)
    return found.states[chosen] + offset + jnp.einsum("nij,nj->ni", found.inward[chosen], inward)


def _folded(states: Array, constraints: Constraints) -> Array:
    """States (N, d), those beyond a bound mirrored at it."""
    inside = constraints.lower + jnp.abs(states - constraints.lower)
    inside = jnp.where(jnp.isfinite(constraints.lower), inside, states)
    inside = jnp.where(jnp.isfinite(constraints.upper), constraints.upper - jnp.abs(constraints.upper - inside), inside)
    return jnp.clip(inside, constraints.lower, constraints.upper)
