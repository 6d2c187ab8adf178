"""Models of the kind that people bring, on which choosing.py tries every filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.growth import growth
from poseppl_models.toys.lorenz96 import lorenz96

from poseppl.program import CompiledModel, StateSpaceModel

SIDE = 10
"""Places along a side of the square of the spatial models; d = 100."""


class Tried(NamedTuple):
    """A compiled model, and its inputs (T, ...) by the number of frames."""

    model: CompiledModel
    inputs: Callable[[int], Any] = lambda frames: None


def volatility() -> Tried:
    """Stochastic volatility: the logarithm of a variance is autoregressive, and scales the data."""

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(0.98 * state["x"], 0.2))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(0.0, jnp.exp(state["x"] / 2)))

    return Tried(StateSpaceModel(initial, transition, observation).compile())


def bearings() -> Tried:
    """Bearings only: a target in the plane, of nearly constant velocity, seen in noise of 0.02 from an observer on a circle."""

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("position", dist.Normal(jnp.array([2.0, 2.0]), 0.5))
        numpyro.sample("velocity", dist.Normal(jnp.zeros(2), 0.05))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("position", dist.Normal(state["position"] + state["velocity"], 0.01))
        numpyro.sample("velocity", dist.Normal(state["velocity"], 0.01))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        away = state["position"] - inputs
        numpyro.sample("direction", dist.Normal(away / jnp.linalg.norm(away), 0.02))

    def observer(frames: int) -> Any:
        angle = np.arange(frames) * 0.1
        return jnp.asarray(np.stack([np.cos(angle), np.sin(angle)], 1), jnp.float32)

    return Tried(StateSpaceModel(initial, transition, observation).compile(jnp.zeros(2)), observer)


def counts() -> Tried:
    """Counts of three kinds: a rate above 0 and shares that sum to 1, both of which wander."""

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("rate", dist.LogNormal(3.0, 0.5))
        numpyro.sample("shares", dist.Dirichlet(jnp.full(3, 5.0)))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("rate", dist.LogNormal(jnp.log(state["rate"]), 0.1))
        numpyro.sample("shares", dist.Dirichlet(1.0 + 200.0 * state["shares"]))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("seen", dist.Poisson(state["rate"] * state["shares"]))

    return Tried(StateSpaceModel(initial, transition, observation).compile())


def switching() -> Tried:
    """A linear system in the plane that changes between turning and resting; its first coordinate is seen."""
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    moves, noises = jnp.asarray(np.stack([turn, 0.9 * np.eye(2)]), jnp.float32), jnp.array([0.1, 0.4])
    stay = jnp.array([[0.95, 0.05], [0.1, 0.9]])

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("regime", dist.Categorical(probs=jnp.array([0.5, 0.5])))
        numpyro.sample("x", dist.Normal(jnp.zeros(2), 1.0).to_event(1))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        regime = numpyro.sample("regime", dist.Categorical(probs=stay[state["regime"]]))
        numpyro.sample("x", dist.Normal(moves[regime] @ state["x"], noises[regime]).to_event(1))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["x"][0], 0.2))

    return Tried(StateSpaceModel(initial, transition, observation).compile())


def spatial(*, counted: bool) -> Tried:
    """A field on a square grid that decays by 0.9 a frame, its innovations correlated over the grid; a sensor at each place.

    After Septier and Peters 2016 (doi:10.1109/JSTSP.2015.2497211), section V: in noise of variance 2, or as counts of mean
    exp(x / 3), which they have with heavier tails of the field.
    """
    places = np.stack(np.meshgrid(np.arange(1, SIDE + 1), np.arange(1, SIDE + 1)), -1).reshape(-1, 2)
    distances = ((places[:, None] - places) ** 2).sum(-1)
    root = jnp.asarray(np.linalg.cholesky(3 * np.exp(-distances / 20) + 0.01 * np.eye(SIDE**2)), jnp.float32)

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.MultivariateNormal(jnp.zeros(SIDE**2), scale_tril=root))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("x", dist.MultivariateNormal(0.9 * state["x"], scale_tril=root))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        seen = dist.Poisson(jnp.exp(state["x"] / 3)) if counted else dist.Normal(state["x"], 2**0.5)
        numpyro.sample("y", seen)

    return Tried(StateSpaceModel(initial, transition, observation).compile())


MODELS: Mapping[str, Callable[[], Tried]] = {
    "stochastic volatility": volatility,
    "bearings only": bearings,
    "growth": lambda: Tried(growth().compile(1.0), lambda frames: jnp.arange(1.0, frames + 1)),
    "hidden Markov": lambda: Tried(finite_hmm().compile()),
    "counts": counts,
    "switching linear": switching,
    "Lorenz-96, d = 40": lambda: Tried(lorenz96(40).compile()),
    "spatial, d = 100": lambda: spatial(counted=False),
    "spatial counts, d = 100": lambda: spatial(counted=True),
}
