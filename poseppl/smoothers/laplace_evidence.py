r"""Laplace's approximation of the evidence of a whole recording, and params that it is largest under.

Around the mode m of p(x, z | theta), with P the curvature there (:mod:`poseppl.smoothers.curvature`) and n = T d,

    log p(z | theta) ~ log p(m, z | theta) + n / 2 log 2 pi - log det P / 2.

From any trajectory m_0 the mode is reached by one step m_0 + P^-1 grad log p where the model is linear and Gaussian, whatever
theta is; so this is exact there, and differentiable by theta without a search inside. Elsewhere the mode is searched again
between rounds of an ascent, and the approximation is that of a single mode.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.block_tridiagonal import solve_with_log_det
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.curvature import trajectory_precisions


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
