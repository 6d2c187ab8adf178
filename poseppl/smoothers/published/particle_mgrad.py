"""Particle-mGRAD and Particle-aGRAD: conditional SMC along the gradient and the Gaussian dynamics.

Corenflos and Finke 2024 (https://arxiv.org/abs/2401.14868). A move draws an auxiliary variable around each state of the
reference trajectory. It runs a conditional filter, whose particles are proposed given this variable and their ancestors'
transition means. Then it draws a trajectory by backward simulation.

A factor of mGRAD's weight at frame t + 1 contains the ancestors of all slots but the one that it weighs, so that it says
nothing of that slot's own ancestor: backward simulation draws x_t^i with probability proportional to w_t^i p(x_(t+1) | x_t^i),
as in a bootstrap filter. Ancestors are multinomial.

Step sizes delta_t are learned frame by frame, in warmup alone and by all chains together, so that a share 1 - (1 + N)^(-1/3) of
the moves changes the frame's state. The scale S and the noise Q of the proposals come from the filter's history and stay.

Chains do not cross between modes that are much farther apart than a step: as with NUTS, each mode's share of the draws is then
that of the chains' starts. The step sizes learned are too short for the two modes of the growth model.

The proposals and weights of one frame: around the reference x' an auxiliary variable is drawn,

    u ~ N(phi(x'), h S),    phi(x) = x + h S grad log g(x),    h = delta / 2,

and particles are proposed by q(x | m, u) ~ N(x; m, Q) N(u; x, h S), m being the mean of the transition from the particle's
ancestor. In coordinates y = W x in which S is the identity and Q = diag(lambda), with a = lambda / (lambda + h),

    q = N(y; (1 - a) m + a u, a h).

Let f be the density of the transition and g the likelihood. Slot n could have been the reference with density proportional to

    w^n = f(x^n) g(x^n) N(u; phi^n, h) / q(x^n | m^n, u)                               (aGRAD: u is kept)
    w^n = f(x^n) g(x^n) integral of N(u; phi^n, h) prod_(k != n) q(x^k | m^k, u) du      (mGRAD: u is integrated out)

because it comes with the proposals of the other slots; what does not depend on n cancels. With e = y - (1 - a) m,
the logarithms of the last factors are, summed over coordinates,

    -(u - phi^n)^2 / 2h + (e^n - a u)^2 / 2ah
    -(phi^n)^2 / 2h + (e^n)^2 / 2ah + (phi^n + sum_(k != n) e^k)^2 / (2h (1 + (N - 1) a)).

Since f stands in the weight, any fixed Q, S and phi leave the posterior invariant; those near the transition's are good.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.particles.resampling import multinomial
from poseppl.particles.stacks import split_first
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_transitions
from poseppl.smoothers.backward_pass import initial_trajectories
from poseppl.smoothers.base import History, Smoothed, Smoother, check_continuous, smoothed_chains
from poseppl.smoothers.conditional_smc import Sweep, draw_back

_MAX = 64
"""Particles of a frame over which the transition's covariance is averaged."""


@memoized_builder
def particle_mgrad_smoother(
    model: CompiledModel,
    *,
    num_particles: int = 32,
    num_chains: int = 4,
    num_draws: int = 250,
    num_warmup: int = 200,
    variant: Variant = "mgrad",
    scaling: Scaling = "covariance",
) -> Smoother:
    """Particle-mGRAD or aGRAD: conditional particle filters that follow gradients.

    Args:
        model: The compiled model; its initial and transition programs have Gaussian moments.
        num_particles: N of each move, the reference included.
        num_chains: M, chains side by side.
        num_draws: R, draws of each chain that count.
        num_warmup: Moves of each chain before them, in which step sizes are learned.
        variant: "mgrad" integrates the auxiliary variable out of the weights, "agrad" keeps it.
        scaling: The scale of a step, from the filter's particles: their "covariance", its diagonal ("spread"), or "none".

    Returns:
        The smoother; its particles are (T, M, R, d), and the draw of one index is a whole trajectory. `acceptance` is the share
        of the moves that changed a frame's state.

    Raises:
        ValueError: A number out of range, an unknown word, or a model with discrete sites; when it smooths, also a site of the
            initial or the transition program without Gaussian moments.
    """
    check_at_least(2, num_particles=num_particles)
    check_at_least(1, num_chains=num_chains, num_draws=num_draws)
    check_at_least(0, num_warmup=num_warmup)
    check_choice(Variant, variant=variant)
    check_choice(Scaling, scaling=scaling)
    check_continuous(model)
    num_moves = num_warmup + num_draws
    target = 1 - (1 + num_particles) ** (-1 / 3)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_start, key_moves = jax.random.split(rng_key)
        starts = initial_trajectories(model, key_start, history, inputs, num_chains)
        axes = _geometries(model, history, inputs, scaling)

        def move(key: Array, xs: Array, h: Array) -> Array:
            return gradient_move(model, key, xs, observations, inputs, axes, h, num_particles, variant)

        def advance(carry: tuple[Array, Array], row: tuple[Array, Array]) -> tuple[Any, tuple[Array, Array]]:
            (xs, log_delta), (key, rate) = carry, row
            moved = jax.vmap(move, (0, 0, None))(jax.random.split(key, num_chains), xs, jnp.exp(log_delta) / 2)
            changed = jnp.mean(jnp.any(moved != xs, -1), 0, dtype=xs.dtype)
            return (moved, jnp.clip(log_delta + rate * (changed - target), -30.0, 5.0)), (moved, changed)

        numbers = jnp.arange(num_moves)
        rates = jnp.where(numbers < num_warmup, (1.0 + numbers) ** -0.4, 0.0).astype(starts.dtype)
        rows = jax.random.split(key_moves, num_moves), rates
        _, (draws, changed) = jax.lax.scan(advance, (starts, jnp.zeros_like(starts[0, :, 0])), rows)
        num_evaluated = float(num_moves * num_chains * starts.shape[1] * num_particles)
        return smoothed_chains(
            jnp.transpose(draws[num_warmup:], (2, 1, 0, 3)),
            acceptance=jnp.mean(changed[num_warmup:], 0),
            num_transition=2 * num_evaluated,
            num_gradient=num_evaluated,
        )

    return Smoother(smooth, joint=True)


def _geometries(model: CompiledModel, history: History, inputs: Any, scaling: Scaling) -> Geometry:
    """The coordinates of every frame, with a leading T."""
    scales = jax.vmap(lambda *frame: scale_of(scaling, *frame))(history.particles, history.log_weights)
    first, later = split_first(inputs)
    before = history.particles[:-1, :_MAX]
    noises = model.initial_moments(first)[1][None]
    if len(before):

        def noise(xs: Array, row: Any) -> Array:
            return jnp.mean(jax.vmap(lambda x: model.transition_moments(x, row)[1])(xs), 0)

        noises = jnp.concatenate([noises, jax.vmap(noise)(before, later)])
    return jax.vmap(geometry)(scales, noises)


class _Frame(NamedTuple):
    """The arguments of a frame of a move: its number, reference (d,), axes, h, data and inputs."""

    number: Array
    kept: Array
    axes: Geometry
    h: Array
    observation: Observation
    inputs: Any


def gradient_move(
    model: CompiledModel,
    rng_key: Array,
    reference: Array,
    observations: Observation,
    inputs: Any,
    axes: Geometry,
    h: Array,
    num_particles: int,
    variant: Variant,
) -> Array:
    """Move from a trajectory (T, d) to another.

    Args:
        model: The compiled model.
        rng_key: PRNG key.
        reference: The trajectory x' (T, d).
        observations: Data with a leading T.
        inputs: Inputs with a leading T, or None.
        axes: Coordinates of the frames, with a leading T.
        h: Half the step sizes (T,).
        num_particles: N, the reference included.
        variant: "mgrad" or "agrad".
    """
    key_back, key_first, key_later = jax.random.split(rng_key, 3)
    first, later = split_first(_Frame(jnp.arange(len(reference)), reference, axes, h, observations, inputs))
    mean = jnp.broadcast_to(model.initial_moments(first.inputs)[0], (num_particles, reference.shape[1]))

    def log_start(particles: Array) -> Array:
        return jax.vmap(lambda x: model.log_initial(x, first.inputs))(particles)

    def advance(carry: tuple[Array, Array], frame: _Frame) -> tuple[Any, Any]:
        previous, log_weights = carry
        key_resample, key_move = jax.random.split(jax.random.fold_in(key_later, frame.number))
        chosen = multinomial(key_resample, log_weights, num_particles - 1)
        ancestors = jnp.concatenate([jnp.zeros(1, jnp.int32), chosen])
        before = previous[ancestors]
        means = jax.vmap(lambda x: model.transition_moments(x, frame.inputs)[0])(before)

        def log_moved(particles: Array) -> Array:
            return log_transitions(model, particles, before, frame.inputs)

        moved = _extend(model, key_move, frame, means, log_moved, variant)
        return moved, (*moved, ancestors)

    start = _extend(model, key_first, first, mean, log_start, variant)
    _, rest = jax.lax.scan(advance, start, later)
    earliest = *start, jnp.zeros(num_particles, jnp.int32)
    sweep = Sweep(*(jnp.concatenate([one[None], many]) for one, many in zip(earliest, rest, strict=True)))
    chosen = draw_back(model, key_back, sweep, inputs)
    return jnp.take_along_axis(sweep.particles, chosen[:, None, None], 1)[:, 0]


def _extend(
    model: CompiledModel, rng_key: Array, frame: _Frame, means: Array, log_prior: Any, variant: Variant
) -> tuple[Array, Array]:
    """Particles (N, d) of a frame with the reference in slot 0, and their log-weights, given their means from before."""
    key_auxiliary, key_move = jax.random.split(rng_key)
    axes, h = frame.axes, frame.h

    def with_gradient(x: Array) -> Any:
        return jax.value_and_grad(model.log_observation)(x, frame.observation, frame.inputs)

    value, gradient = with_gradient(frame.kept)
    phi = shifted(axes, h, frame.kept, gradient)
    u = phi + jnp.sqrt(h) * jax.random.normal(key_auxiliary, phi.shape, phi.dtype)
    moved = propose(key_move, axes, h, u, means[1:])
    particles = jnp.concatenate([frame.kept[None], moved])
    values, gradients = jax.vmap(with_gradient)(moved)
    phis = jnp.concatenate([phi[None], shifted(axes, h, moved, gradients)])
    log_weights = log_prior(particles) + jnp.concatenate([value[None], values])
    log_weights = log_weights + log_correction(variant, axes, h, u, particles, means, phis)
    return particles, nan_to_neg_inf(log_weights)


Variant = Literal["mgrad", "agrad"]
Scaling = Literal["covariance", "spread", "none"]


class Geometry(NamedTuple):
    """Coordinates y = W x of a frame in which S is the identity and Q diagonal.

    Attributes:
        whiten: W (d, d).
        colour: Its inverse (d, d).
        variances: The diagonal lambda of Q in y (d,).
    """

    whiten: Array
    colour: Array
    variances: Array


def geometry(scale: Array, noise: Array) -> Geometry:
    """The coordinates for a scale S and the noise Q of the transition, both (d, d)."""
    factor = jnp.linalg.cholesky(scale)
    inverse = jax.scipy.linalg.solve_triangular(factor, jnp.eye(len(scale), dtype=scale.dtype), lower=True)
    variances, axes = jnp.linalg.eigh(inverse @ noise @ inverse.T)
    floor = float(np.finfo(scale.dtype).eps) * variances[-1]
    return Geometry(axes.T @ inverse, factor @ axes, jnp.maximum(variances, floor))


def scale_of(scaling: Scaling, particles: Array, log_weights: Array) -> Array:
    """S (d, d) of a frame, of the filter's particles (N, d): their covariance, its diagonal, or the identity."""
    dimension = particles.shape[1]
    identity = jnp.eye(dimension, dtype=particles.dtype)
    if scaling == "none":
        return identity
    weights = jax.nn.softmax(log_weights)
    centred = particles - weights @ particles
    spread = jnp.sum(weights[:, None] * centred**2, 0)
    spread = jnp.where(spread > 0, spread, jnp.where(jnp.any(spread > 0), jnp.max(spread) * 1e-6, 1.0))
    shrinkage = 1.0 if scaling == "spread" else 0.1
    return (1 - shrinkage) * (centred.T * weights) @ centred + shrinkage * jnp.diag(spread)


def propose(rng_key: Array, axes: Geometry, h: Array, u: Array, means: Array) -> Array:
    """Draw states (N, d) from q, given u (d,) in y and means (N, d) in x."""
    a = axes.variances / (axes.variances + h)
    centres = (1 - a) * (means @ axes.whiten.T) + a * u
    noise = jax.random.normal(rng_key, means.shape, means.dtype)
    return (centres + jnp.sqrt(a * h) * noise) @ axes.colour.T


def shifted(axes: Geometry, h: Array, xs: Array, gradients: Array) -> Array:
    """Give phi (..., d) in y, of states and gradients (..., d) in x; where a gradient is not finite it counts as zero."""
    finite = jnp.all(jnp.isfinite(gradients), -1, keepdims=True)
    return xs @ axes.whiten.T + h * (jnp.where(finite, gradients, 0.0) @ axes.colour)


def log_correction(variant: Variant, axes: Geometry, h: Array, u: Array, xs: Array, means: Array, phi: Array) -> Array:
    """The last factor of the weights (N,), in logarithms, of states and means (N, d) in x, u (d,) and phi (N, d) in y."""
    a = axes.variances / (axes.variances + h)
    whitened = xs @ axes.whiten.T
    centre = jnp.mean(whitened, 0)  # of all, so that small differences are not lost in large numbers
    e = whitened - centre - (1 - a) * (means @ axes.whiten.T - centre)
    phi, u = phi - centre, u - centre
    if variant == "agrad":
        return jnp.sum(-((u - phi) ** 2) + (e - a * u) ** 2 / a, -1) / (2 * h)
    others = phi + jnp.sum(e, 0) - e
    return jnp.sum(-(phi**2) + e**2 / a + others**2 / (1 + (len(xs) - 1) * a), -1) / (2 * h)
