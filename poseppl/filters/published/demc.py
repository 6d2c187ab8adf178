r"""The DE-MC particle filter (Du and Guan 2006, Monocular human motion tracking with the DE-MC particle filter, ICASSP).

Section 2.3. With N particles of frame k - 1 and their weights w:

1. selection: resample by w;
2. prediction: x_i + V_(k-1), a constant velocity (or a draw from the model's transition), is the first population of T layers
   of DE-MC (:mod:`poseppl.kernels.demc`), with lambda = (1 - c) 2.38 / sqrt(2 d) and noise U(-c sigma, c sigma);
3. estimate: the particle of the largest weight, X_k, and V_k = X_k - X_(k-1). Beside it stands the weighted mean.

The noise of layer t is multiplied by the survival diagnostic of the layer before, 1 / (N sum_i w_i^2) (Eq. 7, in which it grows
with the diagnostic; the text below it says that it should shrink, which `noise_follows="degeneracy"` does: N sum_i w_i^2).
sigma is "the standard deviations of the elements in X": of the particles, or, by `noise_scale="transition"`, of a step of the
model's transition, which does not shrink with the particles.

The argument `target` selects what it computes:

* "likelihood", as published: the DE-MC's function and the weights are the likelihood alone. T layers lead from the prediction
  towards the normalised likelihood, which the weights then square: a seeker of modes, not a sampler of the posterior.
  Directions that a frame's data do not constrain widen by a factor (1 + 2 lambda^2)^(1/2) a layer. If all likelihoods are
  equal, as in a frame without data, the particles stay as predicted.
* "posterior", not in the paper: the predictions, drawn from the transition, are resampled by their likelihoods. The T layers
  leave p(z | x) 1/N sum_j p(x | x_(k-1)^j) invariant, as in the HMC filter, at a cost of O(N^2). It converges to the posterior
  with N; particles count alike, and X_k has the largest posterior density. Eq. 7 is left out, to keep the moves exact.

Copies have no differences to move by. If likelihoods are sharp relative to the prediction, the selection leaves few distinct
particles, and a velocity that all share does not part them: on the 28-DOF body in one camera this loses track within a few
frames, while draws from the transition, the default, keep it. "posterior" suffers alike from its resampling in many dimensions.

If no prediction has any density, as beyond hard limits that a velocity crossed, the velocity is not used: the particles
begin where they were. If they have no density there either, the layers search from the predictions, for a member without
density goes to any that it finds. A frame of which no particle finds any is reported as failed: the particles stay as
predicted, and the velocity, which led nowhere, is dropped. `log_evidence` is that of the particles with which the layers begin.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.errors import UnsuitableModelError
from poseppl.filters.base import EvidenceError, Filter, FilterInfo, filter_info
from poseppl.kernels.demc import DEMCSettings, Members, demc_update
from poseppl.particles.resampling import Resampling, Scheme, resampling_scheme
from poseppl.particles.weights import Normalised, normalise, without_infinity
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, log_likelihoods, log_prediction, propagate

Target = Literal["likelihood", "posterior"]
Prediction = Literal["transition", "velocity"]
NoiseFollows = Literal["survival", "degeneracy", "nothing"]
NoiseScale = Literal["particles", "transition"]


class DEMCState(NamedTuple):
    """Particles after the last layer.

    Attributes:
        particles: Flat states (N, d).
        log_weights: Normalised log-weights (N,).
        best: X_k, the particle of the largest weight or density (d,); the other estimate is the weighted mean.
        velocity: V_k, what `best` moved since the last frame (d,).
    """

    particles: Array
    log_weights: Array
    best: Array
    velocity: Array


class _Layers(NamedTuple):
    """How the particles of a frame evolve.

    Attributes:
        posterior: Whether towards the posterior.
        moves: Moves of each layer.
        noise_follows: The diagnostic that scales the noise.
        scheme: How particles are resampled.
    """

    posterior: bool
    moves: DEMCSettings
    noise_follows: NoiseFollows
    scheme: Resampling


class _Evolved(NamedTuple):
    """A population after T layers.

    Attributes:
        members: Positions and log-densities.
        predicted: The weights of those with which the layers began.
        origin: The prediction that each began as (N,).
        acceptance: Mean acceptance rate.
        num_likelihood: Evaluations of the likelihood, int32.
    """

    members: Members
    predicted: Normalised
    origin: Array
    acceptance: Array
    num_likelihood: Array


@memoized_builder
def demc_filter(
    model: CompiledModel,
    num_particles: int = 1000,
    *,
    num_layers: int = 7,
    target: Target = "likelihood",
    prediction: Prediction = "transition",
    noise: float = 0.1,
    noise_follows: NoiseFollows = "survival",
    noise_scale: NoiseScale = "particles",
    snooker: float = 0.0,
    resampling: Scheme = "systematic",
) -> Filter:
    """The DE-MC particle filter of Du and Guan 2006, moved by differential evolution: it seeks a mode.

    Args:
        model: The compiled model, without finite sites.
        num_particles: N, at least 1; differences need four or more.
        num_layers: T, updates of each particle in a frame.
        target: "likelihood", as published, or "posterior".
        prediction: "transition", draws from the model, or "velocity", as published; "posterior" always takes the transition.
        noise: c, half-width of the noise in units of sigma, in [0, 1).
        noise_follows: "survival" (Eq. 7), "degeneracy" (its inverse) or "nothing".
        noise_scale: sigma, the standard deviations of the "particles" or of a step of the "transition".
        snooker: Probability that a particle makes a snooker update instead.
        resampling: How ancestors are drawn.

    Returns:
        The filter; its state is :class:`DEMCState`.

    Raises:
        ValueError: A setting out of its range.
        UnsuitableModelError: The model has finite sites.
    """
    if model.finite_sites:
        raise UnsuitableModelError(
            f"The model has the finite sites {list(model.finite_sites)}, whose values differential evolution leaves. Use a "
            "particle, a tempered or a hidden Markov filter."
        )
    check_at_least(1, num_particles=num_particles, num_layers=num_layers)
    check_choice(Target, target=target)
    check_choice(Prediction, prediction=prediction)
    check_choice(NoiseFollows, noise_follows=noise_follows)
    check_choice(NoiseScale, noise_scale=noise_scale)
    moves = DEMCSettings(num_updates=num_layers, noise=noise, snooker=snooker).check()
    layers = _Layers(target == "posterior", moves, noise_follows, resampling_scheme(resampling))
    by_velocity = prediction == "velocity" and not layers.posterior
    identity = jnp.arange(num_particles, dtype=jnp.int32)

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[DEMCState, FilterInfo]:
        key_draw, key_evolve = jax.random.split(rng_key)
        predicted = draw_initial(model, jax.random.split(key_draw, num_particles), inputs)
        evolved = _evolve(model, layers, key_evolve, predicted, lambda x: model.log_initial(x, inputs), (observation, inputs))
        return _conclude(evolved, identity, None, layers.posterior)

    def step(rng_key: Array, state: DEMCState, observation: Observation, inputs: Any = None) -> tuple[DEMCState, FilterInfo]:
        key_select, key_draw, key_evolve = jax.random.split(rng_key, 3)
        ancestors = identity if layers.posterior else layers.scheme(key_select, state.log_weights, num_particles)
        previous = state.particles[ancestors]
        drawn = propagate(model, jax.random.split(key_draw, num_particles), previous, inputs)
        predicted = previous + state.velocity if by_velocity else drawn
        sigma = jnp.std(drawn - previous, 0) if noise_scale == "transition" else None

        def log_prior(x: Array) -> Array:
            return log_prediction(model, x, previous, inputs)

        otherwise = previous if by_velocity else None
        evolved = _evolve(model, layers, key_evolve, predicted, log_prior, (observation, inputs), otherwise, sigma)
        return _conclude(evolved, ancestors, state, layers.posterior)

    evidence: EvidenceError = "runs" if layers.posterior else "none"
    return Filter(init, step, evidence=evidence, genealogy=True, differentiable=False)


def _evolve(
    model: CompiledModel,
    layers: _Layers,
    rng_key: Array,
    predicted: Array,
    log_prior: Callable[[Array], Array],
    data: tuple[Observation, Any],
    otherwise: Array | None = None,
    sigma: Array | None = None,
) -> _Evolved:
    """Evolve predictions (N, d); from other positions (N, d) where none of them has density.

    The noise may have its own sigma (d,).
    """
    key_resample, key_layers = jax.random.split(rng_key)
    posterior, num_particles = layers.posterior, predicted.shape[0]

    def weighed(positions: Array) -> tuple[Array, Array]:
        return positions, without_infinity(log_likelihoods(model, positions, *data))

    predicted, values = weighed(predicted)
    lost = jnp.all(jnp.isneginf(values))
    if otherwise is not None:
        there = jax.lax.cond(lost, weighed, lambda _: (predicted, values), otherwise)
        better = jnp.any(there[1] > -jnp.inf)
        predicted, values = jax.tree.map(lambda a, b: jnp.where(better, a, b), there, (predicted, values))
    weighted = normalise(values)
    differ = jnp.any(predicted != predicted[:1])  # copies are alike whatever the data say
    flat = ~weighted.degenerate & (jnp.min(values) == jnp.max(values)) & differ
    origin = identity = jnp.arange(num_particles, dtype=jnp.int32)
    if posterior:
        origin = jnp.where(weighted.degenerate, identity, layers.scheme(key_resample, weighted.log_weights, num_particles))

    def log_density(x: Array) -> Array:
        value = model.log_observation(x, *data)
        return value + log_prior(x) if posterior else value

    def layer(members: Members, rng_key: Array) -> tuple[Members, Array]:
        factor = 1.0 if posterior else _noise_factor(members.values, layers.noise_follows)
        moved, rate = demc_update(rng_key, members, log_density, layers.moves, noise_factor=factor, noise_scale=sigma)
        return moved if posterior else jax.tree.map(lambda old, new: jnp.where(flat, old, new), members, moved), rate

    starts = predicted[origin]
    members = Members(starts, jax.vmap(log_density)(starts) if posterior else values)
    members, rates = jax.lax.scan(layer, members, jax.random.split(key_layers, layers.moves.num_updates))
    rounds = 1 + layers.moves.num_updates + (lost if otherwise is not None else 0)
    return _Evolved(members, weighted, origin, jnp.mean(rates), jnp.int32(num_particles * rounds))


def _conclude(evolved: _Evolved, ancestors: Array, previous: DEMCState | None, posterior: bool) -> tuple[DEMCState, FilterInfo]:
    members, predicted, origin, acceptance, num_likelihood = evolved
    possible = members.values > -jnp.inf
    last = normalise(jnp.where(possible, 0.0, -jnp.inf) if posterior else members.values)
    best = members.positions[jnp.argmax(members.values)]
    velocity = jnp.zeros_like(best) if previous is None else jnp.where(last.degenerate, 0.0, best - previous.best)
    ess = jnp.where(last.degenerate, possible.shape[0], last.ess)
    info = filter_info(
        predicted.log_mean,
        jnp.where(posterior & ~predicted.degenerate, predicted.ess, ess),
        ancestors[origin],
        last.degenerate,
        acceptance=acceptance,
        num_likelihood=num_likelihood,
    )
    return DEMCState(members.positions, last.log_weights, best, velocity), info


def _noise_factor(values: Array, follows: str) -> Array:
    survival = jnp.maximum(normalise(values).ess, 1.0) / values.shape[0]
    return {"survival": survival, "degeneracy": 1.0 / survival, "nothing": jnp.ones_like(survival)}[follows]
