"""The state of a body as NumPyro sites, one for each joint, its Gaussian random walk, and its observations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions
from poseppl.motion.likelihoods import ProjectedMarkers, Silhouettes
from poseppl.program import StateSpaceModel

Programs = tuple[Callable[..., None], Callable[..., None]]
"""The initial and the transition program."""


def joint_sites(coordinates: Sequence[tuple[str, str]]) -> dict[str, slice]:
    """Sites of a body's state and their coordinates: one for each joint that turns, and one for the root's position."""
    sites: dict[str, list[int]] = {}
    for index, (joint, axis) in enumerate(coordinates):
        sites.setdefault(f"{joint}_position" if axis in ("tx", "ty", "tz") else joint, []).append(index)
    return {name: slice(indices[0], indices[-1] + 1) for name, indices in sites.items()}


def random_walk(spans: Mapping[str, slice]) -> Programs:
    """Write the initial and the transition program of the sites.

    Args:
        spans: The sites. Inputs have ``start``, ``start_scale`` and ``step_scale``, each (d,); the last is the standard
            deviation of the step to their frame, whatever the time between two frames.
    """

    def initial(params: Any, inputs: Any) -> None:
        for name, span in spans.items():
            numpyro.sample(name, dist.Normal(inputs.start[span], inputs.start_scale[span]))

    def transition(params: Any, state: Mapping[str, Any], inputs: Any) -> None:
        for name, span in spans.items():
            numpyro.sample(name, dist.Normal(state[name], inputs.step_scale[span]))

    return initial, transition


def mean_reverting_walk(spans: Mapping[str, slice]) -> Programs:
    """Write the programs of :func:`random_walk` for a body's inputs, whose ``posture`` the walk comes back to, if any."""
    initial, walk = random_walk(spans)

    def transition(params: Any, state: Mapping[str, Any], inputs: BodyInputs) -> None:
        if inputs.posture is None:
            return walk(params, state, inputs)
        mean, kept = inputs.posture
        left = {name: mean[span] + kept[span] * (state[name] - mean[span]) for name, span in spans.items()}
        return walk(params, left, inputs)

    return initial, transition


Observe = Callable[[Any, Array, Any], None]
"""``(params, pose, inputs)``: what is observed of a pose (d,)."""


@lru_cache(maxsize=32)
def walking_body(
    coordinates: tuple[tuple[str, str], ...], observe: Observe, walk: Callable[[Mapping[str, slice]], Programs] = random_walk
) -> StateSpaceModel:
    """Write the programs of a body that walks at random and is observed in a pose; the same again, so that bodies share them.

    Args:
        coordinates: Joint and axis of each coordinate.
        observe: Observations of a pose; inputs are those of :func:`random_walk`, too.
        walk: From the sites to the initial and the transition program.
    """
    spans = joint_sites(coordinates)

    def observation(params: Any, state: Mapping[str, Any], inputs: Any) -> None:
        observe(params, jnp.concatenate([state[name] for name in spans]), inputs)

    return StateSpaceModel(*walk(spans), observation)


def see_points(params: Any, pose: Array, inputs: BodyInputs) -> None:
    """Observe the site ``points`` (C, markers, 2) of a pose (d,), whose ``markers`` (K, 3) are kept, mm."""
    numpyro.sample("points", ProjectedMarkers(inputs.tree, inputs.cameras, pose, inputs.noise))
    numpyro.deterministic("markers", marker_positions(inputs.tree, pose))


def see_silhouettes(params: Any, pose: Array, inputs: BodyInputs) -> None:
    """Observe the site ``silhouette`` (C, entries) of a pose (d,), whose ``markers`` (K, 3) are kept, mm."""
    numpyro.sample("silhouette", Silhouettes(inputs.tree, inputs.flesh, inputs.cameras, pose, inputs.seen, inputs.noise))
    numpyro.deterministic("markers", marker_positions(inputs.tree, pose))
