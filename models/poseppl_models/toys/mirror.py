"""Two mirror modes: data of a distance from 0 without its side, and a state that stays on its side.

    x_0 ~ N(0, s_0^2),     x_t ~ N(level tanh(x_(t-1) / width), s^2),     y_t ~ N(|x_t|, r^2),     side_t ~ N(x_t, r^2)

Mask `side` where the side is not known. While it never is, x and -x are equally probable at every frame, and a path crosses
from one side to the other only by a rare jump: a filter has to carry two modes through the whole ambiguous stretch, and a
smoother has to carry back the information of a later frame. State site `x` and data sites `y` and `side`, scalars; no inputs.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel

LEVEL, WIDTH, SPREAD, START, NOISE = 3.0, 1.0, 0.8, 3.0, 0.5


def mirror_mean(x: Any, level: float = LEVEL, width: float = WIDTH) -> Any:
    """Mean of x_t given x_(t-1)."""
    return level * jnp.tanh(jnp.asarray(x) / width)


def mirror(
    level: float = LEVEL, width: float = WIDTH, spread: float = SPREAD, start: float = START, noise: float = NOISE
) -> StateSpaceModel:
    """Build the model.

    Args:
        level: Distance from 0 at which a state stays.
        width: How near to 0 a state has to come to change sides.
        spread: s, standard deviation of the transition.
        start: s_0, standard deviation of the first state.
        noise: r, standard deviation of the data.

    Raises:
        ValueError: A number that is not positive.
    """
    for name, value in (("level", level), ("width", width), ("spread", spread), ("start", start), ("noise", noise)):
        if not value > 0:
            raise ValueError(f"{name} is {value}. Expected a positive number.")

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(0.0, start))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(mirror_mean(state["x"], level, width), spread))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(jnp.abs(state["x"]), noise))
        numpyro.sample("side", dist.Normal(state["x"], noise))

    return StateSpaceModel(initial, transition, observation)
