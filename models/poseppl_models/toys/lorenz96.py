r"""Lorenz's model of 1996 of weather on a circle of latitude, a benchmark of filtering in high dimension.

Lorenz 1996, "Predictability: a problem partly solved" (doi:10.1017/CBO9780511617652.004), Eq. 1:

    dx_i / dt = (x_(i+1) - x_(i-2)) x_(i-1) - x_i + F,    i = 1, ..., d on a circle.

With F = 8 it is chaotic: small errors double in about 0.4 units of time. A frame is 0.05 units, one step of Runge-Kutta's
fourth-order rule, after which noise N(0, q^2) is added; every `stride`-th coordinate is seen with noise N(0, r^2). State site
`x` (d,), data site `y` (ceil(d / stride),); no inputs.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel

TIME_STEP = 0.05
"""Time between two frames; six hours, in Lorenz's reckoning."""


def lorenz96_derivative(x: Any, forcing: float = 8.0) -> Any:
    """dx/dt (d,) at x (d,)."""
    return (jnp.roll(x, -1) - jnp.roll(x, 2)) * jnp.roll(x, 1) - x + forcing


def lorenz96_step(x: Any, forcing: float = 8.0) -> Any:
    """The state (d,) one frame later, without noise."""
    a = lorenz96_derivative(x, forcing)
    b = lorenz96_derivative(x + TIME_STEP / 2 * a, forcing)
    c = lorenz96_derivative(x + TIME_STEP / 2 * b, forcing)
    d = lorenz96_derivative(x + TIME_STEP * c, forcing)
    return x + TIME_STEP / 6 * (a + 2 * b + 2 * c + d)


def lorenz96(
    dimension: int = 40,
    observation_noise: float = 1.0,
    *,
    stride: int = 2,
    transition_noise: float = 0.1,
    initial_spread: float = 1.0,
    forcing: float = 8.0,
) -> StateSpaceModel:
    """Build the model.

    Args:
        dimension: d, at least 4.
        observation_noise: r.
        stride: Every so many-th coordinate is seen, the first among them.
        transition_noise: q.
        initial_spread: Standard deviation of the first state about a state on the attractor.
        forcing: F.

    Raises:
        ValueError: Fewer than 4 dimensions, or a stride below 1.
    """
    if dimension < 4 or stride < 1:
        raise ValueError(f"dimension is {dimension} and stride {stride}. Expected at least 4 and 1.")
    start = jnp.where(jnp.arange(dimension) == 0, forcing + 0.01, forcing)
    for _ in range(400):
        start = lorenz96_step(start, forcing)

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(start, initial_spread))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(lorenz96_step(state["x"], forcing), transition_noise))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["x"][::stride], observation_noise))

    return StateSpaceModel(initial, transition, observation)
