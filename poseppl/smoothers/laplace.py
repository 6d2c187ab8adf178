r"""Laplace's approximation of a whole trajectory: its mode, and a Gaussian of the curvature there.

Damped Gauss-Newton steps over all frames climb to modes of p(x_0, ..., x_(T-1) | z). They start from the mean of the filter's
states, and from the mode for data of negligible weight; the higher mode is m. Each step is a pass of an iterated Kalman
smoother (:mod:`poseppl.smoothers.curvature`), which downweights outliers of robust sites. Draws are m + L^(-T) e with e
standard normal and L L^T the block-tridiagonal curvature at m. Means and standard deviations of the state are those of the
Gaussian. The smoother takes seconds where a Markov chain takes minutes.

At the mode, errors are smaller than the true ones, and robust sites, whose curvature falls with the error, are overconfident:
it is therefore taken at squared errors as large as the Gaussian of the curvature at m expects them to be.

It is exact for linear Gaussian models. Elsewhere it is an approximation that more draws do not improve: one mode alone, and
symmetric tails; :mod:`poseppl.smoothers.trajectory` samples the same density. Sites must be continuous.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.gaussians.block_tridiagonal import BlockCholesky, marginal_covariances, solve_upper
from poseppl.gaussians.marginals import gaussian_marginals
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother, check_continuous
from poseppl.smoothers.curvature import at_expected_errors, climb_to_mode, safe_cholesky, trajectory_precisions
from poseppl.smoothers.effective import smoothed_draws

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
