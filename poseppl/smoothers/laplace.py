"""Laplace's approximation of a whole trajectory, its evidence, and coordinates of the state that do not change.

Damped Gauss-Newton steps over all frames climb to modes of p(x_0, ..., x_(T-1) | z). They start from the mean of the filter's
states, and from the mode for data of negligible weight; the higher mode is m. Each step is a pass of an iterated Kalman
smoother (:mod:`poseppl.smoothers.curvature`), which downweights outliers of robust sites. Draws are m + L^(-T) e with e
standard normal and L L^T the block-tridiagonal curvature at m. Means and standard deviations of the state are those of the
Gaussian. The smoother takes seconds where a Markov chain takes minutes.

At the mode, errors are smaller than the true ones, and robust sites, whose curvature falls with the error, are overconfident:
it is therefore taken at squared errors as large as the Gaussian of the curvature at m expects them to be.

It is exact for linear Gaussian models. Elsewhere it is an approximation that more draws do not improve: one mode alone, and
symmetric tails; :mod:`poseppl.smoothers.trajectory` samples the same density. Sites must be continuous.

With fixed coordinates (:func:`cut_laplace_smoother`), the last p coordinates c of a state (x_t, c) are the same in all frames:
errors of a calibration, say, which are known from another source. Draws are of

    c ~ its prior in the initial program,    x | c, z ~ N(m - R (c - c*), P^-1),    R = P^-1 B,

c* is the prior's mean, and m the mode of x there. P is the curvature of -log p(x, z) there, block tridiagonal, and B_t the
data's cross terms of x_t and c. To first order, intervals of x include the uncertainty of c. The data do not change the
distribution of c, which cuts the feedback (Plummer 2015, doi:10.1007/s11222-014-9503-z): a part of the model that is wrong,
such as a body's lengths, does not spoil c. If c was estimated from the same data, as errors of cameras are, the data do not
count twice.

The step of c in the transition program is not read. It costs p more solves than Laplace's approximation alone, and is exact for
linear Gaussian models.

The evidence is, around the mode m of p(x, z | theta), with P the curvature there (:mod:`poseppl.smoothers.curvature`) and n =
T d,

    log p(z | theta) ~ log p(m, z | theta) + n / 2 log 2 pi - log det P / 2.

From any trajectory m_0 the mode is reached by one step m_0 + P^-1 grad log p where the model is linear and Gaussian, whatever
theta is; so this is exact there, and differentiable by theta without a search inside. Elsewhere the mode is searched again
between rounds of an ascent, and the approximation is that of a single mode.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.gaussians.block_tridiagonal import (
    BlockCholesky,
    BlockTridiagonal,
    marginal_covariances,
    solve,
    solve_upper,
    solve_with_log_det,
)
from poseppl.gaussians.marginals import gaussian_marginals
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother, check_continuous, smoothed_draws
from poseppl.smoothers.curvature import at_expected_errors, climb_to_mode, safe_cholesky, trajectory_precisions

_TOGETHER = 50
"""Trajectories that are drawn side by side."""


@memoized_builder
def laplace_smoother(model: CompiledModel, *, num_draws: int = 500, num_mode_steps: int = 100) -> Smoother:
    """The mode of the whole trajectory with the Gaussian of its curvature: fast, and exact for linear Gaussian models.

    Args:
        model: The compiled model; all its sites are continuous.
        num_draws: N, independent trajectories that are drawn.
        num_mode_steps: Gauss-Newton steps at most, of each of three climbs, of which two go one more.

    Returns:
        The smoother; its particles are (T, N, d), and those of one index are a whole trajectory.

    Raises:
        ValueError: A number out of range, or a model with discrete sites.
    """
    check_at_least(1, num_draws=num_draws, num_mode_steps=num_mode_steps)
    check_continuous(model)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: object = None) -> Smoothed:
        mode, factor, count = laplace_approximation(model, history, observations, inputs, num_mode_steps)
        noise = jax.random.normal(rng_key, (num_draws, *mode.shape), mode.dtype)
        draws = mode + jax.lax.map(lambda z: solve_upper(factor, z), noise, batch_size=_TOGETHER)
        marginals = gaussian_marginals(mode, marginal_covariances(factor).own)
        return smoothed_draws(jnp.moveaxis(draws, 0, 1), marginals, num_gradient=len(mode) * count)

    return Smoother(smooth, joint=True, closed_form=True)


class TrajectoryGaussian(NamedTuple):
    """A Gaussian of a trajectory.

    Attributes:
        mean: Shape (T, d).
        factor: Cholesky factor of its precision.
        num_steps: Gradients that it took to find.
    """

    mean: Array
    factor: BlockCholesky
    num_steps: Array


def laplace_approximation(
    model: CompiledModel, history: History, observations: Observation, inputs: Any, num_mode_steps: int
) -> TrajectoryGaussian:
    """The mode that the filter's mean leads to, with the curvature there at the errors that it expects."""
    start = mean_trajectory(history)
    precision = trajectory_precisions(model, observations, inputs)

    def log_density(xs: Array, weight: Array) -> Array:
        return model.log_joint(xs, observations, inputs, data_weight=weight)

    def factor_at(xs: Array, weight: Array, majorised: Array) -> BlockCholesky:
        return safe_cholesky(precision(xs, None, weight, majorised))

    mode, count = climb_to_mode(log_density, factor_at, start, num_mode_steps)
    factor, _ = at_expected_errors(lambda spread: (safe_cholesky(precision(mode, spread)), None), mode)
    return TrajectoryGaussian(mode, factor, count)


def mean_trajectory(history: History) -> Array:
    """The filter's means (T, d)."""
    return jnp.einsum("tn,tnd->td", jax.nn.softmax(history.log_weights, 1), history.particles)


"""Trajectories that are drawn side by side."""


@memoized_builder
def cut_laplace_smoother(model: CompiledModel, num_static: int, *, num_draws: int = 500, num_mode_steps: int = 100) -> Smoother:
    """Laplace's approximation, with coordinates that do not change and keep their prior.

    Args:
        model: The compiled model; all its sites are continuous, the first state has Gaussian moments, and what does not change
            is independent of the rest in it.
        num_static: p, the number of the state's last coordinates that do not change.
        num_draws: N, independent trajectories that are drawn.
        num_mode_steps: Gauss-Newton steps at most, of each of three climbs, of which two go one more.

    Returns:
        The smoother; its particles are (T, N, d), and those of one index are a whole trajectory.

    Raises:
        ValueError: A number out of range.
    """
    check_at_least(1, num_static=num_static, num_draws=num_draws, num_mode_steps=num_mode_steps)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: object = None) -> Smoothed:
        start = jnp.einsum("tn,tnd->td", jax.nn.softmax(history.log_weights, 1), history.particles)
        mean, covariance = model.initial_moments(tree_index(inputs, 0))
        size = len(mean) - num_static
        static = mean[size:]
        precision = trajectory_precisions(model, observations, inputs)

        def log_density(moving: Array, weight: Array) -> Array:
            return model.log_joint(_whole(moving, static), observations, inputs, data_weight=weight)

        def factor_of(whole: BlockTridiagonal) -> BlockCholesky:
            return safe_cholesky(BlockTridiagonal(whole.diagonal[:, :size, :size], whole.below[:, :size, :size]))

        def factor_at(moving: Array, weight: Array, majorised: Array) -> BlockCholesky:
            return factor_of(precision(_whole(moving, static), None, weight, majorised))

        moving, count = climb_to_mode(log_density, factor_at, start[:, :size], num_mode_steps)

        def about(spread: Array) -> tuple[BlockCholesky, Array]:
            beside = jnp.pad(spread, ((0, 0), (0, num_static), (0, num_static)))
            whole = precision(_whole(moving, static), beside)
            return factor_of(whole), whole.diagonal[:, :size, size:]

        factor, cross = at_expected_errors(about, moving)
        response = jax.vmap(lambda column: solve(factor, column), in_axes=2, out_axes=2)(cross)
        first, second = jax.random.split(rng_key)
        root = jnp.linalg.cholesky(covariance[size:, size:])
        errors = jax.random.normal(first, (num_draws, num_static), moving.dtype) @ root.T
        noise = jax.random.normal(second, (num_draws, *moving.shape), moving.dtype)

        def draw(pair: tuple[Array, Array]) -> Array:
            z, c = pair
            return _whole(moving + solve_upper(factor, z) - response @ c, static + c)

        draws = jax.lax.map(draw, (noise, errors), batch_size=_TOGETHER)
        follow = -response @ covariance[size:, size:]
        own = marginal_covariances(factor).own - follow @ jnp.swapaxes(response, 1, 2)
        rest = jnp.broadcast_to(covariance[size:, size:], (len(start), num_static, num_static))
        around = jnp.block([[own, follow], [jnp.swapaxes(follow, 1, 2), rest]])
        marginals = gaussian_marginals(_whole(moving, static), around)
        return smoothed_draws(jnp.moveaxis(draws, 0, 1), marginals, num_gradient=len(start) * count)

    return Smoother(smooth, joint=True, closed_form=True)


def _whole(moving: Array, static: Array) -> Array:
    """Flat states (T, d) of what moves (T, n) and what does not (p,)."""
    return jnp.concatenate([moving, jnp.broadcast_to(static, (len(moving), len(static)))], 1)


def laplace_evidence(
    model: CompiledModel, xs: Array, observations: Observation, inputs: Any, *, num_steps: int = 1, majorised: bool = False
) -> Array:
    """Log-evidence of data by Laplace's approximation at the mode next to a trajectory.

    Args:
        model: The compiled model, its params set.
        xs: Flat states (T, d) near the mode.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, or None.
        num_steps: Steps to the mode, each by the curvature where it begins; more are valid farther from the mode.
        majorised: Whether the curvature of robust errors is that of the quadratic which touches their potential from above: too
            large, but smooth, where the right one is cut off at 0.

    Returns:
        A scalar, to be differentiated by the params.
    """

    def log_density(xs: Array) -> Array:
        return model.log_joint(xs, observations, inputs)

    precision, mode = trajectory_precisions(model, observations, inputs), xs
    for _ in range(num_steps):
        move, log_det = solve_with_log_det(precision(mode, majorised=majorised), jax.grad(log_density)(mode))
        mode = mode + move
    return log_density(mode) + 0.5 * xs.size * jnp.log(2 * jnp.pi) - 0.5 * log_det
