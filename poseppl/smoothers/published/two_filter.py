"""Two-filter smoothing: a filter that runs backwards meets the one that ran forwards.

Briers, Doucet and Maskell 2010 (doi:10.1007/s10463-009-0236-2). With artificial priors gamma_t, an information filter
approximates gamma~_t(x) ~ gamma_t(x) p(z_t..T-1 | x) by particles x~_t^j of weights w~_t^j, for t = T - 1, ..., 1:

    x~_t ~ q(. | x~_(t+1)),
    w~_t ~ gamma_t(x~_t) p(z_t | x~_t) p(x~_(t+1) | x~_t) / (gamma_(t+1)(x~_(t+1)) q(x~_t | x~_(t+1))),

with ancestors x~_(t+1) resampled by weight. gamma_t and q are Gaussians fitted to the forward filter's particles, so that the
backward filter looks where the forward one was. At frames t >= 1 the
result stands on the backward particles, which are new: smoothing can leave the forward filter's places. Their weights are

    exact:  w_(t|T)^j ~ w~_t^j / gamma_t(x~_t^j) sum_i w_(t-1)^i p(x~_t^j | x_(t-1)^i), O(N^2) a frame,
    linear: the sum over i by `num_pairs` of its terms, drawn by w_(t-1)^i, O(N) a frame,

the second after Fearnhead, Wyncoll and Tawn 2010 (doi:10.1093/biomet/asq013), whose pairs of forward and backward particles
these are. At frame 0 it stands on the forward particles, weighed by the same pairs. For a linear Gaussian model the weights
w~ are nearly equal; gamma and q that miss the smoothing distribution show as a low `ess`.

One Gaussian stands for all modes. On the growth model most series come out better than by forward-backward reweighting, but in
two or three of twenty the backward filter misses a mode that decides (`poseppl reproduce peursum-2010
dimensionality` shows the cost).

The Gaussians are fitted so: for each frame t < T - 1 one successor y_i ~ p(x_(t+1) | x_t^i) is drawn for each particle. The
pairs (x_t^i, y_i), weighted by w_t^i, give means m, m' and covariances P, P' and C = cov(x_t, y):

    gamma_(t+1) = N(m', c P'),    the artificial prior of the next frame: about what the filter predicts,
    q(x_t | y)  = N(m + G (y - m'), c (P - G C^T)),    G = C P'^-1, the regression of a state on its successor,

both widened by the factor c. A Gaussian model's exact backward kernel, given the data up to t, is q with c = 1. Covariances
are kept positive by a small part of P', so that particles that are all equal do no harm.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.scipy.linalg import cho_solve

from poseppl.checks import check_at_least, check_choice
from poseppl.gaussians.gaussian import Factorised, factorise
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import append, tree_index
from poseppl.particles.weights import Normalised, nan_to_neg_inf, normalise, weighted_covariance, weighted_mean
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_likelihoods, log_transition_matrix, log_transitions, propagate
from poseppl.smoothers.base import History, Smoothed, Smoother, check_continuous, smoothing_info
from poseppl.smoothers.tiles import block_size, check_tile, join_rows, split_rows

Method = Literal["exact", "linear"]


class _Backward(NamedTuple):
    """Backward particles (N, d) of one frame, with log w~ (N,), log gamma (N,) and whether no weight was left; or of many."""

    particles: Array
    log_weights: Array
    log_prior: Array
    degenerate: Array


@memoized_builder
def two_filter_smoother(
    model: CompiledModel,
    *,
    method: Method = "exact",
    num_pairs: int = 4,
    inflation: float | None = None,
    tile: int | None = None,
) -> Smoother:
    """Two-filter smoothing: a filter from either end, combined; new particles at each frame.

    Args:
        model: The compiled model, its state continuous.
        method: "exact", O(N^2) a frame, or "linear", O(N).
        num_pairs: Forward particles that "linear" pairs with each backward one, at least 1.
        inflation: Factor c by which the fitted covariances are widened, at least 1; None is 1 + 2 / d.
        tile: Rows of the N x N matrix that "exact" keeps at a time; None keeps about a million entries.

    Returns:
        The smoother; its particles are new, and only each frame's marginal is known.

    Raises:
        ValueError: An unknown method, a number below 1, or a state with integer sites.
    """
    check_tile(tile)
    check_choice(Method, method=method)
    widening = 1.0 + 2.0 / model.dimension if inflation is None else inflation
    check_at_least(1, num_pairs=num_pairs, inflation=widening)
    discrete = [name for name, site in model.sites.items() if site.discrete]
    if discrete:
        raise ValueError(
            f"Sites {discrete} are integers. Use forward_backward_smoother, as Gaussian proposals do not fit them."
        )
    check_continuous(model)

    def meet(rng_key: Array, later: Array, earlier: Array, log_weights: Array, inputs: Any) -> Array:
        """Log of sum_i w^i p(later_j | earlier_i) (N,), or an estimate of it."""
        if method == "exact":
            return _log_predictive(model, tile, later, earlier, log_weights, inputs)
        return _log_predictive_of_pairs(model, num_pairs, rng_key, later, earlier, log_weights, inputs)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        num_frames, num_particles, _ = history.particles.shape
        first = normalise(history.log_weights[0])
        if num_frames == 1:
            return Smoothed(history.particles, first.log_weights[None], smoothing_info(1, first.ess))
        key_backward, key_meet, key_first = jax.random.split(rng_key, 3)
        later_inputs = tree_index(inputs, slice(1, None))
        backward = _information_filter(model, widening, key_backward, history, observations, inputs)

        def combine(row: Any) -> tuple[Array, Array, Array]:
            key, ours, earlier, log_weights, inputs = row
            together = normalise(ours.log_weights - ours.log_prior + meet(key, ours.particles, earlier, log_weights, inputs))
            return together.log_weights, together.ess, together.degenerate | ours.degenerate

        keys = jax.random.split(key_meet, num_frames - 1)
        rows = (keys, backward, history.particles[:-1], history.log_weights[:-1], later_inputs)
        log_weights, ess, unreachable = jax.lax.map(combine, rows)
        start = _first_frame(model, method, tile, key_first, history, tree_index((backward, later_inputs), 0))
        pairs = num_particles if method == "exact" else num_pairs
        info = smoothing_info(
            num_frames,
            jnp.concatenate([start.ess[None], ess]),
            num_transition=float(num_frames - 1) * num_particles * (1.0 + pairs),
            unreachable=jnp.concatenate([start.degenerate[None], unreachable]),
        )
        particles = jnp.concatenate([history.particles[:1], backward.particles])
        return Smoothed(particles, jnp.concatenate([start.log_weights[None], log_weights]), info)

    return Smoother(smooth, joint=False)


def _information_filter(
    model: CompiledModel, inflation: float, rng_key: Array, history: History, observations: Observation, inputs: Any
) -> _Backward:
    """Backward particles of the frames 1 to T - 1, (T - 1, N, ...)."""
    num_frames, num_particles, _ = history.particles.shape
    key_fit, key_last, key_steps = jax.random.split(rng_key, 3)
    seen, given = tree_index((observations, inputs), slice(1, None))
    keys = jax.random.split(key_fit, num_frames - 1)
    forward = (keys, history.particles[:-1], history.log_weights[:-1], given)
    pairs = jax.lax.map(lambda row: pair_moments(model, *row), forward)
    priors, regressions = jax.vmap(partial(summarise, inflation=inflation))(*pairs)
    log_observation = partial(_log_observations, model)
    final = tree_index((priors, seen, given), -1)
    final_set = history.particles[-1], history.log_weights[-1]
    mean, covariance = weighted_mean(*final_set), weighted_covariance(*final_set)
    floor = floor_of(pairs[1][-1][mean.shape[0] :, mean.shape[0] :], mean)
    drawn, log_proposal = factorise(mean, inflation * covariance + floor).draw(key_last, num_particles)
    log_prior = final[0].log_density(drawn)
    log_weights = log_prior - log_proposal + log_observation(drawn, *final[1:])
    last = _backward(drawn, log_weights, log_prior)

    def step(later: _Backward, row: Any) -> tuple[_Backward, _Backward]:
        key, prior, regression, observation, inputs, next_inputs = row
        key_resample, key_draw = jax.random.split(key)
        chosen = systematic(key_resample, later.log_weights, num_particles)
        successors = later.particles[chosen]
        drawn, log_proposal = regression.draw(key_draw, successors)
        log_prior = prior.log_density(drawn)
        moved = log_transitions(model, successors, drawn, next_inputs)
        log_weights = log_prior + log_observation(drawn, observation, inputs) + moved - later.log_prior[chosen] - log_proposal
        result = _backward(drawn, log_weights, log_prior)
        return result, result

    # frame t = 1..T-2: prior of t, regression of t on t + 1, data and inputs of t, inputs of t + 1
    current, following = (tree_index((priors, regressions, seen, given), cut) for cut in (slice(0, -1), slice(1, None)))
    keys = jax.random.split(key_steps, max(num_frames - 2, 1))[: num_frames - 2]
    rows = (keys, current[0], following[1], current[2], current[3], following[3])
    _, earlier = jax.lax.scan(step, last, rows, reverse=True)
    return append(earlier, last)


def _backward(particles: Array, log_weights: Array, log_prior: Array) -> _Backward:
    normalised = normalise(log_weights)
    return _Backward(particles, normalised.log_weights, log_prior, normalised.degenerate)


def _log_observations(model: CompiledModel, xs: Array, observation: Observation, inputs: Any) -> Array:
    """Log-likelihoods (N,); 0 for all when none is finite, as if the frame had no data."""
    values = log_likelihoods(model, xs, observation, inputs)
    return jnp.where(jnp.any(jnp.isfinite(values)), values, 0.0)


def _log_predictive(
    model: CompiledModel, tile: int | None, later: Array, earlier: Array, log_weights: Array, inputs: Any
) -> Array:
    rows = block_size(tile, later.shape[0], earlier.shape[0])

    def add_up(xs: Array) -> Array:
        return _log_sum(log_transition_matrix(model, xs, earlier, inputs) + log_weights, 1)

    return join_rows(jax.lax.map(add_up, split_rows(later, rows)), later.shape[0])


def _log_predictive_of_pairs(
    model: CompiledModel,
    num_pairs: int,
    rng_key: Array,
    later: Array,
    earlier: Array,
    log_weights: Array,
    inputs: Any,
) -> Array:
    """Each later particle meets `num_pairs` earlier ones: a systematic sample, turned by a random number, in large strides."""
    num_later = later.shape[0]
    key_slots, key_turn = jax.random.split(rng_key)
    slots = systematic(key_slots, log_weights, num_later * num_pairs)
    chosen = jnp.roll(slots, jax.random.randint(key_turn, (), 0, slots.shape[0])).reshape(num_pairs, num_later)

    def met(before: Array) -> Array:
        return log_transitions(model, later, before, inputs)

    return _log_sum(jax.vmap(met)(earlier[chosen]), 0) - jnp.log(float(num_pairs))


def _first_frame(
    model: CompiledModel, method: Method, tile: int | None, rng_key: Array, history: History, after: tuple[_Backward, Any]
) -> Normalised:
    """Weights of the forward particles of frame 0."""
    backward, inputs = after
    earlier, log_weights = history.particles[0], history.log_weights[0]
    information = normalise(backward.log_weights - backward.log_prior).log_weights
    if method == "exact":
        rows = block_size(tile, earlier.shape[0], earlier.shape[0])

        def add_up(xs: Array) -> Array:
            return _log_sum(log_transition_matrix(model, backward.particles, xs, inputs) + information[:, None], 0)

        support = join_rows(jax.lax.map(add_up, split_rows(earlier, rows)), earlier.shape[0])
    else:
        key_slots, key_deal = jax.random.split(rng_key)
        met = backward.particles[systematic(key_slots, information, earlier.shape[0])]
        met = jax.random.permutation(key_deal, met)
        support = log_transitions(model, met, earlier, inputs)
    return normalise(log_weights + support)


def _log_sum(terms: Array, axis: int) -> Array:
    """Log of the sum of exp(terms), NaN counting as nothing."""
    total: Array = jax.nn.logsumexp(nan_to_neg_inf(terms), axis=axis)
    return total


_FLOOR = 1e-3
"""Part of the predicted variances that every covariance has at least."""


class Regression(NamedTuple):
    """A state given its successor y: residual.mean + gain (y - next_mean) + a draw of residual less its mean."""

    residual: Factorised
    next_mean: Array
    gain: Array

    def draw(self, rng_key: Array, successors: Array) -> tuple[Array, Array]:
        """Draw states (N, d) given successors (N, d), with the log-densities (N,) of the draws."""
        drawn, log_density = self.residual.draw(rng_key, successors.shape[0])
        return drawn + (successors - self.next_mean) @ self.gain.T, log_density


def pair_moments(
    model: CompiledModel, rng_key: Array, particles: Array, log_weights: Array, inputs: Any
) -> tuple[Array, Array]:
    """Mean (2 d,) and covariance (2 d, 2 d) of a frame's particles (N, d), each beside a successor drawn for it."""
    keys = particle_keys(rng_key, particles.shape[0])
    successors = propagate(model, keys, particles, inputs)
    pairs = jnp.concatenate([particles, successors], 1)
    return weighted_mean(pairs, log_weights), weighted_covariance(pairs, log_weights)


def summarise(mean: Array, covariance: Array, inflation: float) -> tuple[Factorised, Regression]:
    """The artificial prior of the next frame, and the regression of this frame's state on it.

    Args:
        mean: Mean (2 d,) of a state and its successor.
        covariance: Their covariance (2 d, 2 d).
        inflation: c.
    """
    d = mean.shape[0] // 2
    floor = floor_of(covariance[d:, d:], mean[d:])
    predicted, cross = covariance[d:, d:] + floor, covariance[:d, d:]
    gain = cho_solve((jnp.linalg.cholesky(predicted), True), cross.T).T
    residual = covariance[:d, :d] - gain @ cross.T
    residual = inflation * (residual + residual.T) / 2 + floor
    return factorise(mean[d:], inflation * predicted), Regression(factorise(mean[:d], residual), mean[d:], gain)


def floor_of(covariance: Array, mean: Array) -> Array:
    """A small diagonal matrix (d, d) for a covariance to stay positive: of its own variances, and of the digits of the mean."""
    digits = float(jnp.finfo(mean.dtype).eps)  # type: ignore[no-untyped-call]
    return jnp.diag(_FLOOR * jnp.diagonal(covariance) + digits * (1.0 + mean**2))
