"""The growth model, a benchmark of non-linear filtering and smoothing.

Eqs. 28 and 29 of Peursum, Venkatesh and West 2010 (doi:10.1007/s11263-009-0205-5), there in one and in three dimensions, each
coordinate on its own:

    x_t = x_(t-1) / 2 + 25 x_(t-1) / (1 + x_(t-1)^2) + 8 cos(1.2 t) + N(0, 10),    x_1 ~ N(0, 10),
    y_t = x_t^2 / 20 + N(0, 1).

The data do not determine the sign of any coordinate. State site `x` and data site `y`, scalars in one dimension, else (d,);
`inputs` is the time t of the frame, a scalar that counts from 1.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel

VARIANCE = 10.0
"""Variance of the transition and of the first state."""


def growth_mean(x: Any, time: Any) -> Any:
    """Mean of x_t given x_(t-1), with t the time of the new state (Eq. 28)."""
    return x / 2 + 25 * x / (1 + x * x) + 8 * jnp.cos(1.2 * time)


def growth(dimension: int = 1) -> StateSpaceModel:
    """Build the model.

    Args:
        dimension: Number of independent coordinates; 1 gives scalar sites.

    Raises:
        ValueError: A dimension below 1.
    """
    if dimension < 1:
        raise ValueError(f"dimension is {dimension}. Expected at least 1.")
    shape = () if dimension == 1 else (dimension,)
    spread = VARIANCE**0.5

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(0.0, spread).expand(shape))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(growth_mean(state["x"], inputs), spread))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["x"] ** 2 / 20, 1.0))

    return StateSpaceModel(initial, transition, observation)
