r"""The tempered sequential Monte Carlo filter: within each frame, particles are cooled from the prediction to the posterior.

A frame begins as in a particle filter, x_i ~ p(x_t | x_(t-1)^(i)), and goes on as in :mod:`poseppl.filters.tempering`:
temperatures beta from 0 to 1, chosen so that the weights at each keep a given ESS, with HMC or random-walk moves after each
resampling. It needs no proposal, and a frame whose data are far more precise than the prediction costs a few more temperatures
instead of nearly all particles. Two targets of the moves:

* "ancestor", O(N): the ancestor is fixed, p(x | x_(t-1)^(a_i)) p(z_t | x)^beta. On pairs of both this is SMC on

      1/N p(x | x_(t-1)^a) p(z_t | x)^beta,

  whose marginal of the ancestor at beta = 1 is that of the optimal proposal with weights p(z_t | x_(t-1)^a): the ancestors are
  resampled with the states, by likelihoods of states that were moved.
* "mixture", O(N^2): the whole prediction, 1/N sum_j p(x | x_(t-1)^j) p(z_t | x)^beta, as in the HMC filter; a state is not
  bound to its ancestor. Ancestors are drawn again at the end, in proportion to p(x_i | x_(t-1)^j).

Both converge to the posterior with N, and the product of the frames' evidences to the evidence. It is unbiased where nothing is
learned from the particles (`temperatures` given, `whiten=False`, a fixed step size), else up to a bias of order 1/N.

If no particle can explain a frame, it is reported as failed and the particles stay as predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_choice, check_fraction
from poseppl.filters.base import Filter, FilterInfo, filter_info
from poseppl.filters.tempering import Tempered, Tempering, temper
from poseppl.kernels.moves import HMC_MOVES, ConditionalDensity, MoveSettings
from poseppl.particles.resampling import Scheme, resampling_scheme
from poseppl.particles.weights import clustered_ess
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, log_prediction, log_transitions_into, propagate

Target = Literal["ancestor", "mixture"]


class TemperedState(NamedTuple):
    """Equally weighted particles.

    Attributes:
        particles: Flat states (N, d).
        log_weights: Normalised log-weights (N,), all alike.
        log_step_size: The adapted log step size of the moves.
    """

    particles: Array
    log_weights: Array
    log_step_size: Array


class _Prior(NamedTuple):
    """The prior that a frame's particles are cooled from.

    Attributes:
        draw: `rng_key -> particles`, N draws (N, d).
        contexts: The arguments of each density, with a leading axis of N.
        log_density: Log-density of a state, given its context.
    """

    draw: Callable[[Array], Array]
    contexts: Any
    log_density: ConditionalDensity


@memoized_builder
def tempered_filter(
    model: CompiledModel,
    num_particles: int = 500,
    *,
    target: Target = "ancestor",
    moves: MoveSettings = HMC_MOVES,
    ess_target: float = 0.5,
    max_temperatures: int = 100,
    temperatures: tuple[float, ...] | None = None,
    chain_length: int = 1,
    whiten: bool = True,
    resampling: Scheme = "systematic",
) -> Filter:
    """The tempered SMC filter: particles are cooled from the prediction to the posterior, with HMC moves.

    Args:
        model: The compiled model; with HMC moves its densities are differentiated.
        num_particles: N, at least 1.
        target: The invariant distribution of the moves, "ancestor" or "mixture".
        moves: Kernel and settings of the moves, `HMC_MOVES`, `RANDOM_WALK_MOVES` or others.
        ess_target: Fraction of N that the ESS falls to at each temperature but the last, between 0 and 1.
        max_temperatures: Bound on the temperatures of a frame; the last takes all that is left, whatever its ESS.
        temperatures: Fixed temperatures, ascending to 1, instead of adaptive ones.
        chain_length: P of waste-free SMC, a divisor of N: N / P particles are resampled and make P - 1 moves, whose states are
            all kept; 1 moves each of N particles as `moves` says.
        whiten: Whether the particles set the moves' scale in each direction.
        resampling: How ancestors are drawn.

    Returns:
        The filter; its state is :class:`TemperedState`. `FilterInfo.ess` is the least ESS of the frame's temperatures, before
        resampling, or that of particles that descend from few and that moves left alike
        (:mod:`poseppl.particles.weights`), if that is less; `FilterInfo.acceptance` is the mean over temperatures.

    Raises:
        ValueError: A setting out of its range.
    """
    settings = _check(
        num_particles, target, moves, ess_target, max_temperatures, temperatures, chain_length, whiten, resampling
    )

    spread = partial(_prior_covariance, needed=moves.kernel == "random-walk" and whiten, given_ancestor=target == "ancestor")

    def cool(rng_keys: Iterable[Array], prior: _Prior, log_step_size: Array, observation: Observation, inputs: Any) -> Tempered:
        key_draw, key_other, key_run = rng_keys
        particles = prior.draw(key_draw)
        return temper(
            key_run,
            particles,
            prior.contexts,
            prior.log_density,
            lambda x: model.log_observation(x, observation, inputs),
            spread(particles, lambda: prior.draw(key_other)),
            log_step_size,
            settings,
        )

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[TemperedState, FilterInfo]:
        prior = _initial_prior(model, num_particles, inputs)
        step_size = jnp.log(jnp.asarray(moves.step_size, jnp.result_type(float)))
        tempered = cool(jax.random.split(rng_key, 3), prior, step_size, observation, inputs)
        return _state(model, tempered), _info(tempered, tempered.ancestors)

    def step(
        rng_key: Array, state: TemperedState, observation: Observation, inputs: Any = None
    ) -> tuple[TemperedState, FilterInfo]:
        *keys, key_ancestors = jax.random.split(rng_key, 4)
        prior = _transition_prior(model, state.particles, inputs, target)
        tempered = cool(keys, prior, state.log_step_size, observation, inputs)
        if target == "ancestor":
            return _state(model, tempered), _info(tempered, tempered.ancestors)
        ancestors = _draw_ancestors(key_ancestors, model, tempered.particles, state.particles, inputs)
        return _state(model, tempered), _info(tempered, ancestors)

    return Filter(init, step, genealogy=True, differentiable=False)


def _prior_covariance(particles: Array, draw: Callable[[], Array], *, needed: bool, given_ancestor: bool) -> Array:
    """Half the mean square of what two draws differ by, of the same ancestor or of any two."""
    if not needed:
        return jnp.zeros((particles.shape[1],) * 2, particles.dtype)
    difference = particles - (draw() if given_ancestor else jnp.roll(particles, 1, 0))
    return 0.5 * difference.T @ difference / particles.shape[0]


def _initial_prior(model: CompiledModel, num_particles: int, inputs: Any) -> _Prior:
    def draw(rng_key: Array) -> Array:
        return draw_initial(model, jax.random.split(rng_key, num_particles), inputs)

    return _Prior(draw, None, lambda x, _: model.log_initial(x, inputs))


def _transition_prior(model: CompiledModel, previous: Array, inputs: Any, target: Target) -> _Prior:
    def draw(rng_key: Array) -> Array:
        return propagate(model, jax.random.split(rng_key, len(previous)), previous, inputs)

    def log_density(x: Array, ancestor: Array) -> Array:
        if target == "ancestor":
            return model.log_transition(x, ancestor, inputs)
        return log_prediction(model, x, previous, inputs)

    return _Prior(draw, previous, log_density)


def _draw_ancestors(rng_key: Array, model: CompiledModel, particles: Array, previous: Array, inputs: Any) -> Array:
    """An ancestor of each particle (N,), in proportion to p(x_i | x_(t-1)^j)."""
    keys = jax.random.split(rng_key, particles.shape[0])
    draw: Any = jax.vmap(lambda k, x: jax.random.categorical(k, log_transitions_into(model, x, previous, inputs)))
    ancestors: Array = draw(keys, particles)
    return ancestors.astype(jnp.int32)


def _state(model: CompiledModel, tempered: Tempered) -> TemperedState:
    """The state; what takes integers, and was moved as a real number, is the integer that it stands for."""
    count = tempered.particles.shape[0]
    uniform = jnp.full(count, -jnp.log(count), tempered.particles.dtype)
    finite = jnp.asarray(model.finite_coordinates)
    particles = jnp.where(finite, jnp.round(tempered.particles), tempered.particles)
    return TemperedState(particles, uniform, tempered.log_step_size)


def _info(tempered: Tempered, ancestors: Array) -> FilterInfo:
    return filter_info(
        tempered.log_evidence,
        jnp.minimum(jnp.min(tempered.ess), clustered_ess(tempered.particles, tempered.ancestors)),
        ancestors,
        tempered.failed,
        acceptance=tempered.acceptance,
        divergences=tempered.divergences,
        num_likelihood=tempered.num_likelihood,
        num_gradient=tempered.num_gradient,
        step_size=jnp.exp(tempered.log_step_size),
    )


def _check(
    num_particles: int,
    target: Target,
    moves: MoveSettings,
    ess_target: float,
    max_temperatures: int,
    temperatures: tuple[float, ...] | None,
    chain_length: int,
    whiten: bool,
    resampling: Scheme,
) -> Tempering:
    """Check the builder's settings and gather them."""
    check_at_least(1, num_particles=num_particles, max_temperatures=max_temperatures)
    check_choice(Target, target=target)
    check_fraction("(0, 1)", ess_target=ess_target)
    if temperatures is not None:
        steps = [b - a for a, b in zip((0.0, *temperatures), temperatures, strict=False)]
        if not temperatures or min(steps) <= 0 or temperatures[-1] != 1:
            raise RangeError("temperatures", temperatures, "positive numbers that ascend to 1")
    if chain_length < 1 or num_particles % chain_length:
        raise RangeError("chain_length", chain_length, f"a divisor of num_particles = {num_particles}")
    scheme = resampling_scheme(resampling)
    return Tempering(ess_target, max_temperatures, temperatures, chain_length, whiten, moves.check(), scheme)
