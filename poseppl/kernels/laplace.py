"""The local geometry of a posterior: its mode by Gauss-Newton, and coordinates in which it is round.

For a Gaussian prior with precision P around m, and a likelihood with Gauss-Newton curvature I(x) (the Fisher information),
one step from x goes to the mode of the local quadratic model,

    x + (P + I(x))^-1 (grad log p(z | x) - P (x - m)).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.compilation import with_full_precision
from poseppl.gaussians.gaussian import diagonal, lower_inverse
from poseppl.particles.weights import nan_to_neg_inf

_DAMPING = (0.0, 1.0, 0.3, 0.1, 0.01)
"""Fractions of a Gauss-Newton step that are tried; the best is taken, so that the density never falls."""

GAUSS_NEWTON_TRIALS = len(_DAMPING)
"""Densities that a Gauss-Newton step evaluates, beside one gradient."""


class Whitening(NamedTuple):
    """An affine transform x = centre + scale z in which a density is roughly a standard normal.

    Attributes:
        centre: Shape (d,).
        scale: Upper triangular (d, d), or (d,) for a diagonal one.
    """

    centre: Array
    scale: Array

    def to_state(self, z: Array) -> Array:
        """Map whitened coordinates (..., d) to the state."""
        return self.centre + (z * self.scale if self.scale.ndim == 1 else z @ self.scale.T)

    def to_white(self, x: Array) -> Array:
        """Map states (N, d) to whitened coordinates."""
        offset = x - self.centre
        return offset / self.scale if self.scale.ndim == 1 else offset @ lower_inverse(self.scale.T)


def whitening(centre: Array, precision: Array, *, dense: bool = True) -> Whitening:
    """Whiten by a precision matrix.

    Args:
        centre: Shape (d,).
        precision: Symmetric positive definite (d, d).
        dense: False uses the diagonal alone: the step sizes per coordinate of Choo and Fleet 2001, Eq. 17.
    """
    if not dense:
        return Whitening(centre, 1.0 / jnp.sqrt(diagonal(precision)))
    # scaled to a unit diagonal first: millimetres and radians side by side cost float32 its digits
    unit = 1.0 / jnp.sqrt(diagonal(precision))
    lower = jnp.linalg.cholesky(precision * unit[:, None] * unit)
    return Whitening(centre, unit[:, None] * lower_inverse(lower).T)


class Modes(NamedTuple):
    """Local modes and their Laplace approximations.

    Attributes:
        states: Shape (S, d).
        precisions: Curvatures of the negative log-density there (S, d, d).
        scales: Their inverse square roots (S, d, d), upper triangular.
        log_masses: Laplace's integral of the density around each, (S,): log p + d/2 log 2 pi - 1/2 log |precision|.
    """

    states: Array
    precisions: Array
    scales: Array
    log_masses: Array


@with_full_precision
def find_modes(
    starts: Array,
    log_density: Callable[[Array], Array],
    curvature: Callable[[Array], Array],
    num_steps: int,
) -> Modes:
    """Climb from many starts by damped Gauss-Newton, side by side.

    Args:
        starts: Shape (S, d).
        log_density: Unnormalised log posterior density of one state, a scalar.
        curvature: P + I(x) (d, d) at one state.
        num_steps: How many steps; each is damped, or left out, so that the density never falls.
    """
    damping = jnp.array(_DAMPING, starts.dtype)

    def describe_and_climb(x: Array) -> tuple[Modes, Array]:
        value, gradient = jax.value_and_grad(log_density)(x)
        precision = curvature(x)
        scale = whitening(x, precision).scale
        volume = jnp.sum(jnp.log(diagonal(scale))) + 0.5 * x.shape[0] * jnp.log(2 * jnp.pi)
        mass = nan_to_neg_inf(value + volume)
        best = likeliest(log_density, x + damping[:, None] * (scale @ (scale.T @ gradient)))
        return Modes(x, precision, scale, mass), jnp.where(jnp.all(jnp.isfinite(best)), best, x)

    def step(carry: tuple[Modes, Array], _: None) -> tuple[tuple[Modes, Array], None]:
        return jax.vmap(describe_and_climb)(carry[1]), None

    # a last turn whose climb nobody uses: cheaper than compiling the description a second time
    square = jnp.zeros((*starts.shape, starts.shape[1]), starts.dtype)
    empty = Modes(starts, square, square, jnp.zeros_like(starts[:, 0]))
    (modes, _), _ = jax.lax.scan(step, (empty, starts), None, length=num_steps + 1)
    return modes


def likeliest(log_density: Callable[[Array], Array], trials: Array) -> Array:
    """The trial of the highest density, of trials (K, ...)."""
    return trials[jnp.argmax(nan_to_neg_inf(jax.vmap(log_density)(trials)))]


def mode_log_weights(modes: Modes) -> Array:
    """Log-weights (S,) of modes in a mixture, of which several may be the same one: these share its mass.

    Each is the importance weight of its state under the mixture of all S Laplace approximations, log p - log sum_k N(.; k): a
    mode that n starts came to has its mass once, and not n times.
    """
    half_log_det = jnp.sum(jnp.log(diagonal(modes.scales)), 1)
    offset = modes.states[:, None] - modes.states
    distance = jnp.einsum("ski,kij,skj->sk", offset, modes.precisions, offset)
    # the factors of 2 pi in the density and in the mixture cancel
    log_mixture = jax.nn.logsumexp(jnp.nan_to_num(-0.5 * distance - half_log_det, nan=-jnp.inf), axis=1)
    shared = modes.log_masses - half_log_det - log_mixture
    return nan_to_neg_inf(shared)


_SAME_MODE = 3.0
"""Standard deviations of either Laplace approximation within which two states belong to the same mode."""


class Located(Protocol):
    """States (S, d) with precisions (S, d, d)."""

    @property
    def states(self) -> Array:
        """Shape (S, d)."""

    @property
    def precisions(self) -> Array:
        """Shape (S, d, d)."""


def group_modes(modes: Located, within: float = _SAME_MODE, *, mutual: bool = False) -> Array:
    """Labels (S,) of modes that are the same one: the index of the first of those that are linked by steps of a few sd.

    Args:
        modes: Which states and precisions count.
        within: Standard deviations of either Laplace approximation that a step has at most.
        mutual: Whether it has to be short for both of them.
    """
    offset = modes.states[:, None] - modes.states
    distance = jnp.einsum("ski,kij,skj->sk", offset, modes.precisions, offset)
    apart = jnp.maximum(distance, distance.T) if mutual else jnp.minimum(distance, distance.T)
    linked = apart < within**2
    linked = linked | jnp.eye(len(linked), dtype=bool)

    def chained(_: Any, reached: Array) -> Array:
        return jnp.minimum(reached @ reached, 1.0)

    return jnp.argmax(jax.lax.fori_loop(0, (len(linked) - 1).bit_length(), chained, linked.astype(jnp.float32)), 1)


def group_masses(modes: Modes, labels: Array) -> Array:
    """Log-masses (S,) of the groups that modes belong to, at every one of their members."""
    return jax.nn.logsumexp(jnp.where(labels[:, None] == labels, modes.log_masses, -jnp.inf), axis=1)
