"""The state of a body as NumPyro sites, one for each joint, and its Gaussian random walk."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpyro
import numpyro.distributions as dist


def joint_sites(coordinates: Sequence[tuple[str, str]]) -> dict[str, slice]:
    """Sites of a body's state and their coordinates: one for each joint that turns, and one for the root's position."""
    sites: dict[str, list[int]] = {}
    for index, (joint, axis) in enumerate(coordinates):
        sites.setdefault(f"{joint}_position" if axis in ("tx", "ty", "tz") else joint, []).append(index)
    return {name: slice(indices[0], indices[-1] + 1) for name, indices in sites.items()}


def random_walk(spans: Mapping[str, slice]) -> tuple[Callable[..., None], Callable[..., None]]:
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
