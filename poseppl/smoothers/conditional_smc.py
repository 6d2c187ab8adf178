"""Conditional sequential Monte Carlo, a move between trajectories, and particle Gibbs smoothing, the chain of its moves.

Andrieu, Doucet and Holenstein 2010 (doi:10.1111/j.1467-9868.2009.00736.x), section 4.3. A bootstrap filter of N particles runs
with one slot, the first, fixed to the reference trajectory x'. The other N - 1 draw their ancestors independently by the
weights and are moved by the transition; all are weighed by the likelihood. A trajectory is then drawn. Without further steps
the reference's early frames hardly ever change. One of two additions corrects that:

* ancestor sampling (Lindsten, Jordan and Schoen 2014, algorithm 2, https://jmlr.org/papers/v15/lindsten14a.html): at each frame
  the reference's past is drawn again, with probability proportional to w_(t-1)^i p(x'_t | x_(t-1)^i). The trajectory is traced
  back along the ancestors from a particle of the last frame, drawn by its weight;
* backward simulation (Whiteley 2010, in the discussion of Andrieu et al.): the trajectory is drawn from the last frame to the
  first, each state with probability proportional to w_t^i p(x_(t+1) | x_t^i).

Both are exact for any N >= 2. Ancestors are multinomial: other schemes are biased here unless they are conditioned too (Chopin
and Singh 2015, doi:10.3150/14-BEJ629).

Each move leaves the joint smoothing distribution invariant for any number of
particles; more particles make the chain mix faster, not more exact. It needs no gradient and no Gaussian, and takes discrete
states. Chains start from trajectories drawn from the filter's history (:mod:`poseppl.smoothers.backward_pass`).

Static parameters are learned with it by :func:`poseppl.smoothers.static_parameters.particle_gibbs`.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import multinomial
from poseppl.particles.stacks import split_first
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, log_likelihoods, propagate
from poseppl.smoothers.backward_pass import Earlier, backward_pass, initial_trajectories, log_backward
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothed_chains
from poseppl.smoothers.genealogy import lines

Method = Literal["ancestor", "backward"]


class Sweep(NamedTuple):
    """Particles (T, N, d), log-weights (T, N) and ancestors (T, N), of which those of the first frame stand for nothing."""

    particles: Array
    log_weights: Array
    ancestors: Array


def conditional_smc(
    model: CompiledModel,
    rng_key: Array,
    reference: Array,
    observations: Observation,
    inputs: Any,
    num_particles: int,
    method: Method,
) -> Array:
    """Move from a trajectory (T, d) to another.

    Args:
        model: The compiled model; its params may be tracers.
        rng_key: PRNG key.
        reference: The trajectory x' (T, d).
        observations: Data with a leading T.
        inputs: Inputs with a leading T, or None.
        num_particles: N, the reference included.
        method: "ancestor" or "backward".
    """
    key_sweep, key_trace = jax.random.split(rng_key)
    sweep = _run(model, key_sweep, reference, observations, inputs, num_particles, method)
    if method == "ancestor":
        path = lines(sweep.ancestors, _draw(key_trace, sweep.log_weights[-1]))
    else:
        path = draw_back(model, key_trace, sweep, inputs)
    return sweep.particles[jnp.arange(path.shape[0]), path]


def _run(
    model: CompiledModel,
    rng_key: Array,
    reference: Array,
    observations: Observation,
    inputs: Any,
    num_particles: int,
    method: Method,
) -> Sweep:
    """The filter, with the reference in slot 0."""
    num_free = num_particles - 1

    def weigh(particles: Array, observation: Observation, inputs: Any) -> Array:
        return nan_to_neg_inf(log_likelihoods(model, particles, observation, inputs))

    def advance(carry: tuple[Array, Array], row: Any) -> tuple[Any, Any]:
        particles, log_weights = carry
        number, kept, observation, inputs = row
        key_resample, key_move, key_past = jax.random.split(jax.random.fold_in(key_later, number), 3)
        chosen = multinomial(key_resample, log_weights, num_free)
        moved = propagate(model, particle_keys(key_move, num_free), particles[chosen], inputs)
        past = jnp.zeros((), jnp.int32)
        if method == "ancestor":
            past = _draw_past(model, key_past, kept, particles, log_weights, inputs, past)
        particles = jnp.concatenate([kept[None], moved])
        log_weights = weigh(particles, observation, inputs)
        return (particles, log_weights), (particles, log_weights, jnp.concatenate([past[None], chosen]))

    key_first, key_later = jax.random.split(rng_key)
    first, later = split_first((reference, observations, inputs))
    drawn = draw_initial(model, particle_keys(key_first, num_free), first[2])
    particles = jnp.concatenate([first[0][None], drawn])
    log_weights = weigh(particles, *first[1:])
    _, rest = jax.lax.scan(advance, (particles, log_weights), (jnp.arange(reference.shape[0] - 1), *later))
    start = particles, log_weights, jnp.zeros(num_particles, jnp.int32)
    return Sweep(*(jnp.concatenate([one[None], many]) for one, many in zip(start, rest, strict=True)))


def _draw_past(
    model: CompiledModel,
    rng_key: Array,
    x: Array,
    particles: Array,
    log_weights: Array,
    inputs: Any,
    otherwise: Array,
) -> Array:
    """A particle of the frame before, drawn by w^i p(x | x^i), int32; `otherwise` if none has any probability."""
    return _draw(rng_key, log_backward(model, x, particles, log_weights, inputs)[0], otherwise)


def _draw(rng_key: Array, log_weights: Array, otherwise: Any = 0) -> Array:
    """A particle drawn by weight, int32; `otherwise`, the reference by default, if none has any."""
    possible = jnp.any(log_weights > -jnp.inf)
    drawn = jax.random.categorical(rng_key, jnp.where(possible, log_weights, 0.0)).astype(jnp.int32)
    return jnp.where(possible, drawn, otherwise)


def draw_back(model: CompiledModel, rng_key: Array, sweep: Sweep, inputs: Any) -> Array:
    """Indices (T,) of a trajectory by backward simulation."""
    key_last, key_earlier = jax.random.split(rng_key)
    numbers = jnp.arange(sweep.particles.shape[0] - 1)

    def step(number: Array, index: Array, frame: Earlier) -> tuple[Array, None]:
        key = jax.random.fold_in(key_earlier, number)
        x, particles, otherwise = frame.later[index], frame.particles, frame.ancestors[index]
        return _draw_past(model, key, x, particles, frame.log_weights, frame.inputs, otherwise), None

    return backward_pass(step, numbers, *sweep, inputs, _draw(key_last, sweep.log_weights[-1]))[0]


@memoized_builder
def particle_gibbs_smoother(
    model: CompiledModel,
    *,
    num_particles: int = 100,
    num_chains: int = 4,
    num_draws: int = 250,
    num_warmup: int = 25,
    method: Method = "ancestor",
) -> Smoother:
    """Particle Gibbs: conditional particle filters with ancestor sampling or backward simulation.

    Args:
        model: The compiled model.
        num_particles: N of each move, the reference included.
        num_chains: M, chains side by side.
        num_draws: R, draws of each chain that count.
        num_warmup: Moves of each chain before them.
        method: "ancestor" sampling or "backward" simulation.

    Returns:
        The smoother; its particles are (T, M, R, d), and the draw of one index is a whole trajectory. `acceptance` is the share
        of the moves that changed a frame's state.

    Raises:
        ValueError: A number out of range, or an unknown method.
    """
    check_at_least(2, num_particles=num_particles)
    check_at_least(1, num_chains=num_chains, num_draws=num_draws)
    check_at_least(0, num_warmup=num_warmup)
    check_choice(Method, method=method)
    num_moves = num_warmup + num_draws

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_start, key_moves = jax.random.split(rng_key)
        starts = initial_trajectories(model, key_start, history, inputs, num_chains)

        def move(key: Array, xs: Array) -> Array:
            return conditional_smc(model, key, xs, observations, inputs, num_particles, method)

        def advance(xs: Array, key: Array) -> tuple[Array, tuple[Array, Array]]:
            moved = jax.vmap(move)(jax.random.split(key, num_chains), xs)
            return moved, (moved, jnp.mean(jnp.any(moved != xs, -1), 0))

        _, (draws, changed) = jax.lax.scan(advance, starts, jax.random.split(key_moves, num_moves))
        return smoothed_chains(
            jnp.transpose(draws[num_warmup:], (2, 1, 0, 3)),
            acceptance=jnp.mean(changed[num_warmup:], 0),
            num_transition=float(num_moves * num_chains * (starts.shape[1] - 1) * num_particles),
        )

    return Smoother(smooth, joint=True)
