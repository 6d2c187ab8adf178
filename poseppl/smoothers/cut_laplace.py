r"""Laplace's approximation of a whole trajectory, with coordinates of the state that do not change and are not learned from it.

The last p coordinates c of a state (x_t, c) are the same in all frames: errors of a calibration, say, which are known from
another source. Draws are of

    c ~ its prior in the initial program,    x | c, z ~ N(m - R (c - c*), P^-1),    R = P^-1 B,

c* is the prior's mean, and m the mode of x there. P is the curvature of -log p(x, z) there, block tridiagonal, as in
:mod:`poseppl.smoothers.laplace`, and B_t the data's cross terms of x_t and c. To first order, intervals of x include the
uncertainty of c. The data do not change the distribution of c, which cuts the feedback (Plummer 2015,
doi:10.1007/s11222-014-9503-z): a part of the model that is wrong, such as a body's lengths, does not spoil c. If c was
estimated from the same data, as errors of cameras are, the data do not count twice.

The step of c in the transition program is not read. It costs p more solves than Laplace's approximation alone, and is exact for
linear Gaussian models.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.gaussians.block_tridiagonal import BlockCholesky, BlockTridiagonal, marginal_covariances, solve, solve_upper
from poseppl.gaussians.marginals import gaussian_marginals
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother
from poseppl.smoothers.curvature import at_expected_errors, climb_to_mode, safe_cholesky, trajectory_precisions
from poseppl.smoothers.effective import smoothed_draws

_TOGETHER = 50
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
