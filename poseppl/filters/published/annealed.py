r"""The annealed particle filter (Deutscher and Reid 2005, doi:10.1023/B:VISI.0000043757.18370.9c): a seeker of modes.

In the form of section 6 of Darby, Li and Costen 2008 and section 3.2 of Peursum, Venkatesh and West 2010
(doi:10.1007/s11263-009-0205-5). A frame has R layers, r = R, ..., 1:

1. particles are resampled by the last layer's weights and dispersed: by the transition in the first layer of a frame, then by
   Gaussian noise of the diagonal covariance P_r = tau^(R - r) P (Eq. 10), which shrinks as the layers go on;
2. they are weighted by p(z | x)^beta_r (Eq. 6), with the beta_r at which a fraction tau of the particles survives (Eq. 7):
   the survival diagnostic 1 / sum w_i^2 is tau N, found by bisection.

P is the variance of the transition, from pairs of draws with a common ancestor, unless given; what takes integers stays as it
was drawn. With crossover (Deutscher, Davison and Reid 2001, doi:10.1109/CVPR.2001.991028), a particle has two parents, and
groups of coordinates come from either.

It is not a sampler of the posterior. Each layer weighs by the likelihood again, so that after R layers the particles have
gathered where the likelihood is highest within reach of the prediction; their spread says how far the layers have come, not how
much is known, and more particles do not change that. `log_evidence` is that of the particles as predicted, from such a set.
:mod:`poseppl.filters.tempered` anneals with the weights that make it a sampler.

If a layer's likelihoods are all equal, as in a frame without data, no noise is added. If no
particle can explain a frame, it is reported as failed and the particles stay as predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least, check_fraction
from poseppl.filters.base import Filter, FilterInfo, filter_info
from poseppl.particles.resampling import Resampling, Scheme, resampling_scheme
from poseppl.particles.weights import Normalised, effective_sample_size, normalise, without_infinity
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, log_likelihoods, propagate

_BISECTIONS = 50
_WIDTH = 25.0
"""Half-width of the bracket of log beta, around the inverse of the spread of the log-likelihoods."""


class AnnealedState(NamedTuple):
    """Particles of the last layer.

    Attributes:
        particles: Flat states (N, d).
        log_weights: Normalised log-weights of the last layer (N,).
        best: The particle of the highest likelihood (d,); the other estimate is the weighted mean.
    """

    particles: Array
    log_weights: Array
    best: Array


class _Layer(NamedTuple):
    """Particles (N, d), their log-likelihoods (N,), -inf where impossible, and their ancestors (N,)."""

    particles: Array
    values: Array
    ancestors: Array


Keys = tuple[Array, Array]
Disperse = Callable[[Array, Array, Array], Array]
"""`(rng_key, centres (N, d), tau^(R - r)) -> particles (N, d)` of a later layer."""
PredictParticles = Callable[[Keys, Array | None, Any], tuple[Array, Disperse]]
"""`(two keys, particles before (N, d) or None, inputs)` to the first layer's particles (N, d), and how later ones disperse."""


class Annealing(NamedTuple):
    """How a frame's layers are gone through.

    Attributes:
        num_layers: R.
        survival: tau.
        groups: Number of the group of each coordinate (d,); None makes no crossover.
        resampling: A scheme.
    """

    num_layers: int
    survival: float
    groups: np.ndarray[Any, Any] | None
    resampling: Resampling


@memoized_builder
def annealed_filter(
    model: CompiledModel,
    num_particles: int = 1000,
    *,
    num_layers: int = 10,
    survival: float = 0.5,
    diffusion: Array | None = None,
    crossover: Sequence[Sequence[int | str]] | None = None,
    resampling: Scheme = "multinomial",
) -> Filter:
    """The annealed particle filter: it seeks a mode of the likelihood, and does not sample the posterior.

    Args:
        model: The compiled model.
        num_particles: N in each layer, at least 1.
        num_layers: R, at least 1.
        survival: tau, the fraction of particles that survives a layer, between 0 and 1.
        diffusion: Diagonal of P (d,), variances; by default the transition's (in the first frame the initial state's).
        crossover: Groups of coordinates, by index or name, that stay together when two parents are crossed; coordinates of no
            group come from the first parent. None makes no crossover.
        resampling: How ancestors are drawn.

    Returns:
        The filter; its state is :class:`AnnealedState`. `FilterInfo.ess` is that of the last layer.

    Raises:
        ValueError: A number out of its range, an unknown coordinate, or one in two groups.
    """
    settings = annealing_of(model, num_particles, num_layers, survival, diffusion, crossover, resampling)

    return annealing_filter(model, num_particles, settings, predict_by_transition(model, num_particles, diffusion))


def annealing_of(
    model: CompiledModel,
    num_particles: int,
    num_layers: int,
    survival: float,
    diffusion: Array | None,
    crossover: Sequence[Sequence[int | str]] | None,
    resampling: Scheme,
) -> Annealing:
    """Check the settings of :func:`annealed_filter`, and gather them."""
    check_at_least(1, num_particles=num_particles, num_layers=num_layers)
    check_fraction("(0, 1)", survival=survival)
    if diffusion is not None and (np.shape(diffusion) != (model.dimension,) or np.any(np.asarray(diffusion) < 0)):
        raise ValueError(f"diffusion has shape {np.shape(diffusion)}. Expected variances of shape ({model.dimension},).")
    groups = None if crossover is None else _group_numbers(model, crossover)
    return Annealing(num_layers, survival, groups, resampling_scheme(resampling))


def predict_by_transition(model: CompiledModel, num_particles: int, diffusion: Array | None) -> PredictParticles:
    """Draws of the transition, at the first frame of the initial program; P as given, or from pairs of draws."""

    def predict(rng_keys: Keys, previous: Array | None, inputs: Any) -> tuple[Array, Disperse]:
        def draw(rng_key: Array) -> Array:
            keys = jax.random.split(rng_key, num_particles)
            return draw_initial(model, keys, inputs) if previous is None else propagate(model, keys, previous, inputs)

        drawn, other = map(draw, rng_keys)
        variance = 0.5 * jnp.mean((drawn - other) ** 2, 0) if diffusion is None else jnp.asarray(diffusion, other.dtype)
        variance = jnp.where(jnp.asarray(model.finite_coordinates), 0.0, variance)  # not of what takes integers

        def disperse(rng_key: Array, centres: Array, shrinking: Array) -> Array:
            noise = jax.random.normal(rng_key, centres.shape, centres.dtype)
            return centres + jnp.sqrt(shrinking * variance) * noise

        return drawn, disperse

    return predict


def annealing_filter(model: CompiledModel, num_particles: int, settings: Annealing, predict: PredictParticles) -> Filter:
    """Build an annealed filter from how its particles are predicted and dispersed."""

    def values_of(particles: Array, data: tuple[Observation, Any]) -> Array:
        return without_infinity(log_likelihoods(model, particles, *data))

    def anneal(
        rng_key: Array, predicted: Array, disperse: Disperse, ancestors: Array, data: tuple[Observation, Any]
    ) -> tuple[AnnealedState, FilterInfo]:
        values = values_of(predicted, data)
        first = normalise(values)
        layer = _refine(rng_key, _Layer(predicted, values, ancestors), disperse, lambda x: values_of(x, data), settings)
        log_weights = _layer_weights(layer.values, settings.survival)
        state = AnnealedState(layer.particles, log_weights, layer.particles[jnp.argmax(layer.values)])
        return state, _info(first, log_weights, layer.ancestors, settings.num_layers)

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[AnnealedState, FilterInfo]:
        key_draw, key_other, key_layers = jax.random.split(rng_key, 3)
        ancestors = jnp.arange(num_particles, dtype=jnp.int32)
        return anneal(key_layers, *predict((key_draw, key_other), None, inputs), ancestors, (observation, inputs))

    def step(
        rng_key: Array, state: AnnealedState, observation: Observation, inputs: Any = None
    ) -> tuple[AnnealedState, FilterInfo]:
        key_resample, key_draw, key_other, key_layers = jax.random.split(rng_key, 4)
        ancestors = settings.resampling(key_resample, state.log_weights, num_particles)
        predicted = predict((key_draw, key_other), state.particles[ancestors], inputs)
        return anneal(key_layers, *predicted, ancestors, (observation, inputs))

    return Filter(init, step, evidence="none", genealogy=True)


def _refine(
    rng_key: Array,
    first: _Layer,
    disperse: Disperse,
    log_likelihoods: Callable[[Array], Array],
    settings: Annealing,
) -> _Layer:
    """From a frame's first layer, of the particles as predicted, to its last."""

    def next_layer(layer: _Layer, item: tuple[Array, Array]) -> tuple[_Layer, None]:
        key_resample, key_cross, key_noise = jax.random.split(item[0], 3)
        log_weights = _layer_weights(layer.values, settings.survival)
        chosen = settings.resampling(key_resample, log_weights, len(log_weights))
        centres = layer.particles[chosen]
        if settings.groups is not None:
            centres = _cross(key_cross, centres, layer.particles, log_weights, settings.groups)
        particles = disperse(key_noise, centres, settings.survival ** item[1])
        after = _Layer(particles, log_likelihoods(particles), layer.ancestors[chosen])
        flat = jnp.min(layer.values) == jnp.max(layer.values)
        keep = flat | ~jnp.any(jnp.isfinite(after.values))
        return jax.tree.map(lambda old, new: jnp.where(keep, old, new), layer, after), None

    keys = jax.random.split(rng_key, settings.num_layers - 1)
    last, _ = jax.lax.scan(next_layer, first, (keys, jnp.arange(1, settings.num_layers)))
    return last


def _cross(rng_key: Array, first: Array, particles: Array, log_weights: Array, groups: np.ndarray[Any, Any]) -> Array:
    """Cross parents (N, d) with other ones that are drawn by the weights, group by group."""
    key_parent, key_choice = jax.random.split(rng_key)
    second = particles[jax.random.categorical(key_parent, log_weights, shape=first.shape[:1])]
    swap = jax.random.bernoulli(key_choice, 0.5, (first.shape[0], groups.max() + 1)).at[:, 0].set(False)
    return jnp.where(swap[:, groups], second, first)


def _info(predicted: Normalised, log_weights: Array, ancestors: Array, num_layers: int) -> FilterInfo:
    ess, evaluations = effective_sample_size(log_weights), log_weights.shape[0] * num_layers
    return filter_info(predicted.log_mean, ess, ancestors, predicted.degenerate, num_likelihood=evaluations)


def annealing_exponent(log_likelihoods: Array, survival: float) -> Array:
    """The beta at which a fraction `survival` of the particles of positive likelihood survives.

    Args:
        log_likelihoods: Shape (N,), none NaN or +inf.
        survival: tau; the survival diagnostic 1 / sum w_i^2 of the weights exp(beta * log_likelihoods) becomes tau N.

    Returns:
        A positive scalar; very large where more than tau N particles share the highest likelihood.
    """
    finite = jnp.isfinite(log_likelihoods)
    goal = survival * jnp.sum(finite)
    peak = jnp.max(jnp.where(finite, log_likelihoods, -jnp.inf))
    below = jnp.where(finite, log_likelihoods - peak, -jnp.inf)
    spread = jnp.sum(jnp.where(finite, -below, 0.0)) / jnp.maximum(jnp.sum(finite), 1)
    centre = -jnp.log(jnp.where(spread > 0, spread, 1.0))

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        enough = effective_sample_size(jnp.exp(middle) * below) >= goal
        return jnp.where(enough, middle, low), jnp.where(enough, high, middle)

    low, _ = jax.lax.fori_loop(0, _BISECTIONS, halve, (centre - _WIDTH, centre + _WIDTH))
    return jnp.exp(low)


def _layer_weights(values: Array, survival: float) -> Array:
    """Normalised log-weights (N,) of a layer: uniform where all values are equal or impossible."""
    peak = jnp.max(values)
    return normalise(annealing_exponent(values, survival) * (values - jnp.where(jnp.isfinite(peak), peak, 0.0))).log_weights


def _group_numbers(model: CompiledModel, crossover: Sequence[Sequence[int | str]]) -> np.ndarray[Any, Any]:
    """For each coordinate the number of its group from 1 on, 0 where it has none (d,)."""
    names = {name: index for index, name in enumerate(model.coordinate_names)}
    numbers = np.zeros(model.dimension, int)
    for number, group in enumerate(crossover, 1):
        for coordinate in group:
            index = names.get(coordinate, -1) if isinstance(coordinate, str) else coordinate
            if not 0 <= index < model.dimension:
                raise ValueError(f"crossover names {coordinate!r}. Expected coordinates among {', '.join(names)}.")
            if numbers[index]:
                raise ValueError(f"crossover names {coordinate!r} twice. Expected groups that do not overlap.")
            numbers[index] = number
    return numbers
