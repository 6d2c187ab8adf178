r"""The curvature of a transition with Gaussian moments.

-log N(x_t; m(x_(t-1)), Q) has a Gauss-Newton Hessian in (x_(t-1), x_t) that is never negative, with J = dm / dx at x_(t-1):

    (-J, 1)^T Q^(-1) (-J, 1).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from poseppl.program import CompiledModel


def transition_curvature(model: CompiledModel, previous: jax.Array, inputs: Any) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The blocks (t-1, t-1), (t, t-1) and (t, t) of the curvature, each (d, d).

    Args:
        model: The compiled model, its transition program with Gaussian moments.
        previous: The state at t - 1 (d,).
        inputs: Inputs of frame t.

    Raises:
        ValueError: The transition program has no Gaussian moments.
    """
    jacobian = jax.jacrev(lambda state: model.transition_moments(state, inputs)[0])(previous)
    precision = precision_of(model.transition_moments(previous, inputs)[1])
    pulled = precision @ jacobian
    return jacobian.T @ pulled, -pulled, precision


def precision_of(covariance: jax.Array) -> jax.Array:
    """Inverse of a covariance (d, d), scaled to a unit diagonal on the way."""
    unit = 1.0 / jnp.sqrt(jnp.diagonal(covariance))
    inverse: jax.Array = jnp.linalg.inv(covariance * unit[:, None] * unit)
    return inverse * unit[:, None] * unit
