"""A banana-shaped posterior in the plane: what a kernel has to bend around, known by quadrature.

    (a, b) ~ N(0, s^2 I),    y | a, b ~ N(b + c a^2, n^2)

State sites `a` and `b`, data site `y`, all scalars; no inputs. Over time the state takes a small random walk (drift 0 is not a
density; use a tiny one for a target that stands still).
"""

from __future__ import annotations

from typing import Any

import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel


def banana(curvature: float = 1.0, spread: float = 1.0, noise: float = 0.2, drift: float = 0.1) -> StateSpaceModel:
    """Build the model.

    Args:
        curvature: c, how much the ridge bends.
        spread: s, standard deviation of the prior.
        noise: n, half-width of the ridge.
        drift: Standard deviation of the random walk.

    Raises:
        ValueError: A standard deviation that is not positive.
    """
    for name, value in (("spread", spread), ("noise", noise), ("drift", drift)):
        if not value > 0:
            raise ValueError(f"{name} is {value}. Expected a positive standard deviation.")

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("a", dist.Normal(0.0, spread))
        numpyro.sample("b", dist.Normal(0.0, spread))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("a", dist.Normal(state["a"], drift))
        numpyro.sample("b", dist.Normal(state["b"], drift))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["b"] + curvature * state["a"] ** 2, noise))

    return StateSpaceModel(initial, transition, observation)
