"""The Rauch-Tung-Striebel smoother on a Kalman filter's forward pass (Rauch, Tung and Striebel 1965, doi:10.2514/3.3166).

With the filtered N(m_t, P_t), the transition linearised there with Jacobian A and predicted N(m', P') at t + 1,

    G = P_t A^T P'^-1,    m^s_t = m_t + G (m^s_(t+1) - m'),    P^s_t = P_t + G (P^s_(t+1) - P') G^T.

Exact for linear Gaussian programs. The forward pass is made anew from the data, as a history of particles does not hold the
Gaussians; draws are whole trajectories, drawn backwards, x_t ~ N(m_t + G (x_(t+1) - m'), P_t - G P' G^T).

With more than one iteration transitions and observations are linearised again, around the smoothed Gaussians of the last pass,
and both passes begin anew at the initial program: the iterated posterior linearisation smoother (Garcia-Fernandez, Svensson and
Sarkka 2017, doi:10.1109/TAC.2016.2592681).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.compilation import with_full_precision
from poseppl.filters.kalman import update
from poseppl.gaussians.gaussian import Gaussian, lower_inverse
from poseppl.gaussians.linearisation import Method, linearise_about, predict
from poseppl.gaussians.marginals import gaussian_marginals
from poseppl.particles.stacks import append, prepend, rows_of, split_first
from poseppl.program import CompiledModel, Observation
from poseppl.program.built_once import built_once
from poseppl.smoothers.base import History, Smoothed, Smoother
from poseppl.smoothers.effective import smoothed_draws


@built_once
def rauch_tung_striebel_smoother(
    model: CompiledModel, *, num_draws: int = 1000, linearisation: Method = "first-order", num_iterations: int = 1
) -> Smoother:
    """Rauch-Tung-Striebel smoothing of a Kalman filter, extended or unscented: one Gaussian.

    Args:
        model: The compiled model, all its programs with Gaussian moments.
        num_draws: Trajectories to draw.
        linearisation: "first-order", "unscented" or "gauss-hermite" (up to 6 coordinates).
        num_iterations: Passes, each but the first linearised around what the last one smoothed.

    Raises:
        ValueError: A number below 1 or an unknown linearisation.
    """
    check_at_least(1, num_draws=num_draws, num_iterations=num_iterations)
    check_choice(Method, linearisation=linearisation)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        forward = _passes(model, observations, inputs, linearisation, num_iterations)
        particles = draw_backwards(rng_key, forward, num_draws)
        num_frames = len(particles)
        marginals = gaussian_marginals(*backward_moments(forward))
        return smoothed_draws(particles, marginals, num_transition=float(num_frames), num_gradient=2.0 * num_frames)

    return Smoother(smooth, joint=True, closed_form=True)


@with_full_precision
def smoothed_moments(
    model: CompiledModel,
    observations: Observation,
    inputs: Any = None,
    *,
    linearisation: Method = "first-order",
    num_iterations: int = 1,
) -> Gaussian:
    """Means (T, d) and covariances (T, d, d) of the smoothing distributions, without draws."""
    return backward_moments(_passes(model, observations, inputs, linearisation, num_iterations))


class ForwardPass(NamedTuple):
    """Filtered and predicted Gaussians of all frames, and the gains G (T, d, d) from each frame to the one before (0 at 0)."""

    filtered: Gaussian
    predicted: Gaussian
    gains: Array


def _passes(model: CompiledModel, observations: Observation, inputs: Any, method: Method, num_iterations: int) -> ForwardPass:
    """The last forward pass."""
    found = _forward(model, observations, inputs, method)

    def again(_: int, found: ForwardPass) -> ForwardPass:
        new = _forward(model, observations, inputs, method, backward_moments(found))
        usable = jnp.all(jnp.isfinite(new.filtered.mean)) & jnp.all(jnp.isfinite(new.gains))
        kept: ForwardPass = jax.tree.map(lambda a, b: jnp.where(usable, a, b), new, found)
        return kept

    return found if num_iterations == 1 else jax.lax.fori_loop(1, num_iterations, again, found)


def backward_moments(forward: ForwardPass) -> Gaussian:
    """Means (T, d) and covariances (T, d, d) of the smoothed Gaussians."""
    filtered, predicted, gains = forward
    last = rows_of(filtered, -1)

    def back(later: Gaussian, row: Any) -> tuple[Gaussian, Gaussian]:
        (mean, covariance), ahead, gain = row
        smoothed = Gaussian(
            mean + gain @ (later.mean - ahead.mean), covariance + gain @ (later.covariance - ahead.covariance) @ gain.T
        )
        return smoothed, smoothed

    earlier, ahead = rows_of(filtered, slice(-1)), rows_of(predicted, slice(1, None))
    _, rest = jax.lax.scan(back, last, (earlier, ahead, gains[1:]), reverse=True)
    return append(rest, last)


def _forward(
    model: CompiledModel, observations: Observation, inputs: Any, method: Method, about: Gaussian | None = None
) -> ForwardPass:
    """The forward pass, linearised around given Gaussians (T, ...), or as a Kalman filter if None."""
    first, later = split_first((observations, inputs))
    predicted = Gaussian(*model.initial_moments(first[1]))
    filtered = update(model, predicted, *first, method, about=rows_of(about, 0))[0]

    def advance(filtered: Gaussian, row: Any) -> tuple[Gaussian, ForwardPass]:
        (observation, inputs), before, now = row
        around = filtered if before is None else before
        predicted, gain = predict_with_gain(model, filtered, around, inputs, method)
        new = update(model, predicted, observation, inputs, method, about=now)[0]
        return new, ForwardPass(new, predicted, gain)

    rows = later, rows_of(about, slice(-1)), rows_of(about, slice(1, None))
    _, rest = jax.lax.scan(advance, filtered, rows)
    return prepend(ForwardPass(filtered, predicted, jnp.zeros_like(filtered.covariance)), rest)


def predict_with_gain(
    model: CompiledModel, filtered: Gaussian, around: Gaussian, inputs: Any, method: Method
) -> tuple[Gaussian, Array]:
    """The Gaussian of the next frame, whose inputs these are, and G (d, d); the transition is linearised around another."""
    linear = linearise_about(lambda x: model.transition_moments(x, inputs), filtered, around, method)
    predicted = predict(filtered, linear)
    whiten = lower_inverse(jnp.linalg.cholesky(predicted.covariance))
    return predicted, (whiten @ linear.jacobian @ filtered.covariance).T @ whiten


def draw_backwards(rng_key: Array, forward: ForwardPass, num_draws: int) -> Array:
    """Draw trajectories (T, N, d); directions in which rounding left no variance stay where they are."""
    filtered, predicted, gains = forward
    earlier, ahead = rows_of(filtered, slice(-1)), rows_of(predicted, slice(1, None))
    left = earlier.covariance - gains[1:] @ ahead.covariance @ jnp.swapaxes(gains[1:], 1, 2)
    values, vectors = jnp.linalg.eigh(append(left, filtered.covariance[-1]))
    noise = jax.random.normal(rng_key, (len(values), num_draws, values.shape[1]), values.dtype)
    moved = filtered.mean[:, None] + (noise * jnp.sqrt(jnp.maximum(values, 0.0))[:, None]) @ jnp.swapaxes(vectors, 1, 2)

    def back(later: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        free, mean, gain = row
        draws = free + (later - mean) @ gain.T
        return draws, draws

    _, draws = jax.lax.scan(back, moved[-1], (moved[:-1], ahead.mean, gains[1:]), reverse=True)
    return append(draws, moved[-1])
