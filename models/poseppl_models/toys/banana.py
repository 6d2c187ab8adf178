"""A banana-shaped posterior in the plane: what a kernel has to bend around, known by quadrature.

    (a, b) ~ N(0, I),    y | a, b ~ N(b + c a^2, n^2)

State sites `a` and `b`, data site `y`, all scalars; no inputs. Over time the state takes a small random walk.
"""

from __future__ import annotations

from typing import Any

import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel

_DRIFT = 0.1
"""Standard deviation of the random walk."""


def banana(curvature: float = 1.0, noise: float = 0.2) -> StateSpaceModel:
    """Build the model.

    Args:
        curvature: c, how much the ridge bends.
        noise: n, half-width of the ridge.

    Raises:
        ValueError: A noise that is not positive.
    """
    if not noise > 0:
        raise ValueError(f"noise is {noise}. Expected a positive standard deviation.")

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("a", dist.Normal(0.0, 1.0))
        numpyro.sample("b", dist.Normal(0.0, 1.0))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("a", dist.Normal(state["a"], _DRIFT))
        numpyro.sample("b", dist.Normal(state["b"], _DRIFT))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["b"] + curvature * state["a"] ** 2, noise))

    return StateSpaceModel(initial, transition, observation)
