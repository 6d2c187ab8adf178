"""The Rauch-Tung-Striebel smoother on a Kalman filter's forward pass (Rauch, Tung and Striebel 1965, doi:10.2514/3.3166).

With the filtered N(m_t, P_t), the transition linearised there with Jacobian A and predicted N(m', P') at t + 1,

    G = P_t A^T P'^-1,    m^s_t = m_t + G (m^s_(t+1) - m'),    P^s_t = P_t + G (P^s_(t+1) - P') G^T.

Exact for linear Gaussian programs. The forward pass is repeated from the data, because a history of particles does not contain
the Gaussians; draws are whole trajectories, drawn backwards, x_t ~ N(m_t + G (x_(t+1) - m'), P_t - G P' G^T).

With more than one iteration transitions and observations are linearised again, around the smoothed Gaussians of the last pass,
and both passes begin again at the initial program: the iterated posterior linearisation smoother (Garcia-Fernandez, Svensson
and Sarkka 2017, doi:10.1109/TAC.2016.2592681).

Both passes can be parallel in time (:mod:`poseppl.gaussians.parallel`): the same result for linear programs, in fewer steps on
a GPU. The first pass of others is then linearised at the initial mean, so that they need iterations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.compilation import with_full_precision
from poseppl.filters.in_parallel import linear_sequence
from poseppl.filters.kalman import gaussian_form, update
from poseppl.gaussians.diffuse import DiffuseGaussian, backward_conditional
from poseppl.gaussians.gaussian import Gaussian, RootGaussian, lower_inverse, semidefinite_root, triangular
from poseppl.gaussians.linearisation import Linear, Method, Moments, linearise_about, predict
from poseppl.gaussians.marginals import gaussian_marginals
from poseppl.gaussians.parallel import smooth_in_parallel
from poseppl.particles.stacks import append, prepend, split_first, tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import GaussianPasses, History, Smoothed, Smoother, smoothing_info


@memoized_builder
def rauch_tung_striebel_smoother(
    model: CompiledModel,
    *,
    num_draws: int = 1000,
    linearisation: Method = "first-order",
    num_iterations: int = 1,
    parallel: bool = False,
) -> Smoother:
    """Rauch-Tung-Striebel smoothing of a Kalman filter, extended or unscented: one Gaussian.

    Args:
        model: The compiled model, all its programs with Gaussian moments.
        num_draws: Trajectories to draw.
        linearisation: "first-order", "unscented" or "gauss-hermite" (up to 6 coordinates).
        num_iterations: Passes, each but the first linearised around what the last one smoothed.
        parallel: Whether frames are smoothed in parallel rather than one after the other; for linear programs, or with
            iterations.

    Raises:
        ValueError: A number below 1 or an unknown linearisation.
    """
    check_at_least(1, num_draws=num_draws, num_iterations=num_iterations)
    check_choice(Method, linearisation=linearisation)

    def forward(history: History, observations: Observation, inputs: Any) -> ForwardPass:
        return _passes(model, observations, inputs, linearisation, num_iterations, parallel)

    backward = parallel_moments if parallel else backward_moments
    return gaussian_smoother(forward, num_draws, evaluations=(1.0, 2.0), reads_particles=False, backward=backward)


def gaussian_smoother(
    forward: Callable[[History, Observation, Any], ForwardPass],
    num_draws: int,
    *,
    evaluations: tuple[float, float],
    reads_particles: bool = True,
    backward: Callable[[ForwardPass], RootGaussian] | None = None,
) -> Smoother:
    """The smoother of a forward pass: its backward pass and draws of trajectories.

    Args:
        forward: `(history, observations, inputs) -> forward pass`.
        num_draws: Trajectories to draw.
        evaluations: Evaluations of the transition and of a frame's gradient, for each frame.
        reads_particles: Whether the forward pass reads the history.
        backward: The backward pass; :func:`backward_moments` if None.
    """
    smoothed = backward or backward_moments

    def passes(history: History, observations: Observation, inputs: Any) -> GaussianPasses:
        found = forward(history, observations, inputs)
        means, num_frames = found.filtered.mean, len(found.predicted)
        roots = append(found.left[1:], _root(tree_index(found.filtered, -1)))
        counts = dict(zip(("num_transition", "num_gradient"), (each * num_frames for each in evaluations), strict=True))
        info = smoothing_info(num_frames, jnp.asarray(num_draws), **counts)
        return GaussianPasses(smoothed(found), means, found.predicted, found.gains, roots, info)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        found = passes(history, observations, inputs)
        particles = draw_backwards(rng_key, found, num_draws)
        log_weights = jnp.full(particles.shape[:2], -jnp.log(num_draws), particles.dtype)
        marginals = gaussian_marginals(found.smoothed.mean, found.smoothed.covariance)
        return Smoothed(particles, log_weights, found.info, marginals)

    more = {"passes": with_full_precision(passes), "num_draws": num_draws, "reads_particles": reads_particles}
    return Smoother(smooth, joint=True, closed_form=True, **more)  # type: ignore[arg-type]


@with_full_precision
def smoothed_moments(
    model: CompiledModel,
    observations: Observation,
    inputs: Any = None,
    *,
    linearisation: Method = "first-order",
    num_iterations: int = 1,
    parallel: bool = False,
) -> Gaussian:
    """Means (T, d) and covariances (T, d, d) of the smoothing distributions, without draws."""
    forward = _passes(model, observations, inputs, linearisation, num_iterations, parallel)
    smoothed = (parallel_moments if parallel else backward_moments)(forward)
    return Gaussian(smoothed.mean, smoothed.covariance)


class ForwardPass(NamedTuple):
    """A filter's Gaussians of all frames, and how each frame's state depends on the next one's.

    Attributes:
        filtered: Means (T, d) and covariances, which may be roots.
        predicted: Means (T, d) of the predictions.
        gains: G (T, d, d), from each frame to the one before; 0 at the first.
        left: Roots (T, d, d) of the covariance of the frame before given each frame, P_t - G P' G^T; 0 at the first.
    """

    filtered: Gaussian | RootGaussian | DiffuseGaussian
    predicted: Array
    gains: Array
    left: Array


def _passes(
    model: CompiledModel, observations: Observation, inputs: Any, method: Method, num_iterations: int, parallel: bool
) -> ForwardPass:
    """The last forward pass."""
    pass_of, backward = (_forward_in_parallel, parallel_moments) if parallel else (_forward, backward_moments)
    found = pass_of(model, observations, inputs, method)

    def again(_: int, found: ForwardPass) -> ForwardPass:
        new = pass_of(model, observations, inputs, method, backward(found))
        usable = jnp.all(jnp.isfinite(new.filtered.mean)) & jnp.all(jnp.isfinite(new.gains))
        kept: ForwardPass = jax.tree.map(lambda a, b: jnp.where(usable, a, b), new, found)
        return kept

    return found if num_iterations == 1 else jax.lax.fori_loop(1, num_iterations, again, found)


def backward_moments(forward: ForwardPass) -> RootGaussian:
    """Means (T, d) and covariances of the smoothed Gaussians, by their roots (T, d, d)."""
    last: Any = tree_index(forward.filtered, -1)
    end = RootGaussian(last.mean, _root(last))

    def back(later: RootGaussian, row: Any) -> tuple[RootGaussian, RootGaussian]:
        mean, ahead, gain, left = row
        scale = triangular(jnp.hstack([left, gain @ later.scale]))
        smoothed = RootGaussian(mean + gain @ (later.mean - ahead), scale)
        return smoothed, smoothed

    rows = forward.filtered.mean[:-1], forward.predicted[1:], forward.gains[1:], forward.left[1:]
    _, rest = jax.lax.scan(back, end, rows, reverse=True)
    return append(rest, end)


def parallel_moments(forward: ForwardPass) -> RootGaussian:
    """The same, in parallel."""
    left = forward.left @ jnp.swapaxes(forward.left, 1, 2)
    filtered = Gaussian(forward.filtered.mean, forward.filtered.covariance)
    smoothed = smooth_in_parallel(filtered, forward.predicted, forward.gains, left)
    return RootGaussian(smoothed.mean, jax.vmap(semidefinite_root)(smoothed.covariance))


def _root(x: Gaussian | RootGaussian | DiffuseGaussian) -> Array:
    """L, lower triangular (d, d), with L L^T a covariance that may be singular."""
    if isinstance(x, DiffuseGaussian):
        return x.proper.scale
    return x.scale if isinstance(x, RootGaussian) else semidefinite_root(x.covariance)


def _forward(
    model: CompiledModel, observations: Observation, inputs: Any, method: Method, about: RootGaussian | None = None
) -> ForwardPass:
    """The forward pass, linearised around given Gaussians (T, ...), or as a Kalman filter if None."""
    first, later = split_first((observations, inputs))
    predicted: Any = gaussian_form(model)(*model.initial_moments(first[1], diffuse=True))
    filtered = update(model, predicted, *first, method, about=tree_index(about, 0))[0]

    def advance(filtered: Any, row: Any) -> tuple[Any, ForwardPass]:
        (observation, inputs), before, now = row
        around = filtered if before is None else before
        predicted, gain, left = predict_with_gain(model, filtered, around, inputs, method)
        new = update(model, predicted, observation, inputs, method, about=now)[0]
        return new, ForwardPass(new, predicted.mean, gain, left)

    rows = later, tree_index(about, slice(-1)), tree_index(about, slice(1, None))
    _, rest = jax.lax.scan(advance, filtered, rows)
    nothing = jnp.zeros_like(filtered.covariance)
    return prepend(ForwardPass(filtered, predicted.mean, nothing, nothing), rest)


def _forward_in_parallel(
    model: CompiledModel, observations: Observation, inputs: Any, method: Method, about: RootGaussian | None = None
) -> ForwardPass:
    """The same in parallel; without Gaussians to linearise around, all frames are linearised around the initial one."""
    sequence = linear_sequence(model, observations, inputs, method, about)
    initial, filtered = sequence.initial, sequence.filtered
    num_frames = len(filtered.mean)
    around = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_frames, *leaf.shape)), initial) if about is None else about
    before, later = tree_index(around, slice(-1)), tree_index(inputs, slice(1, None))

    def ahead(filtered: Gaussian, around: RootGaussian, inputs: Any) -> tuple[Gaussian, Array, Array]:
        return predict_with_gain(model, filtered, around, inputs, method)

    predicted, gains, left = jax.vmap(ahead)(tree_index(filtered, slice(-1)), before, later)
    none = jnp.zeros_like(initial.scale)
    return ForwardPass(filtered, prepend(initial.mean, predicted.mean), prepend(none, gains), prepend(none, left))


def predict_with_gain(
    model: CompiledModel, filtered: Moments, around: Gaussian | RootGaussian | DiffuseGaussian, inputs: Any, method: Method
) -> tuple[Moments, Array, Array]:
    """The Gaussian of the next frame, whose inputs these are, G (d, d), and the root (d, d) of what is left of the covariance.

    The transition is linearised around another Gaussian. All comes from one triangular factor [[S', 0], [C, L]] of the joint
    covariance of the next and this state: S' S'^T = P', G = C S'^-1 and L L^T = P - G P' G^T.
    """
    linear: Linear = linearise_about(lambda x: model.transition_moments(x, inputs), filtered, around, method)
    either: Any = filtered
    if isinstance(either, DiffuseGaussian):
        return predict(filtered, linear), *backward_conditional(either, linear)
    root, size = _root(filtered), filtered.mean.shape[0]
    moved = linear.jacobian @ root
    # what is certain, such as an earlier datum in the state, says nothing of the state before: a unit keeps S' invertible
    certain = jnp.all(moved == 0, 1) & (jnp.diagonal(linear.noise) == 0)
    ahead = jnp.hstack([moved, semidefinite_root(linear.noise + jnp.diag(certain.astype(moved.dtype)))])
    joint = triangular(jnp.vstack([ahead, jnp.hstack([root, jnp.zeros_like(root)])]))
    gain = joint[size:, :size] @ lower_inverse(joint[:size, :size])
    return predict(filtered, linear), gain, joint[size:, size:]


def draw_backwards(rng_key: Array, passes: GaussianPasses, num_draws: int) -> Array:
    """Draw trajectories (T, N, d)."""
    means = passes.means
    noise = jax.random.normal(rng_key, (len(means), num_draws, means.shape[1]), means.dtype)
    moved = means[:, None] + noise @ jnp.swapaxes(passes.roots, 1, 2)

    def back(later: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        free, mean, gain = row
        draws = free + (later - mean) @ gain.T
        return draws, draws

    _, draws = jax.lax.scan(back, moved[-1], (moved[:-1], passes.predicted[1:], passes.gains[1:]), reverse=True)
    return append(draws, moved[-1])
