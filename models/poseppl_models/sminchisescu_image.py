"""Bodies of Sminchisescu and Triggs (2001) seen in images: programs with the image cost and all of the priors of section 3.2.

The state and its walk within joint limits and about equilibria are those of :mod:`poseppl_models.sminchisescu`. A frame's data
are residuals whose value is 0, ``image`` of the cost (:mod:`poseppl_models.sminchisescu_likelihood`) and ``parts`` of parts
that run through each other (:mod:`poseppl_models.non_penetration`): both have gradients and Gauss-Newton curvature.

Flow compares with the frame before, and so with a pose then, that comes by the inputs (``seen.previous``): a tracker gives its
estimate. The programs' own transition knows nothing of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray

from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.geometry.superquadrics import Superquadrics
from poseppl.motion.vision import EnergySettings, dense_flow, edge_energy, flow_outliers, motion_boundaries
from poseppl.program import StateSpaceModel
from poseppl_models.non_penetration import non_penetration_residuals
from poseppl_models.sminchisescu import Limits, limited_body
from poseppl_models.sminchisescu_body import Kind, superquadric_body
from poseppl_models.sminchisescu_cost import CostNoise, CostSettings, ImageSeen
from poseppl_models.sminchisescu_likelihood import ContourAndFlow

Images = Sequence[NDArray[Any]]


class CostInputs(NamedTuple):
    """Inputs of one frame.

    Attributes:
        cameras: C cameras, px.
        seen: What was seen.
        noise: Standard deviations of edges and flow, and the cameras' weights.
        start: Mean of the first state (d,).
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,), mm and radians.
        tree: The person's own tree.
        flesh: The person's own flesh.
    """

    cameras: Cameras
    seen: ImageSeen
    noise: CostNoise
    start: jax.Array
    start_scale: jax.Array
    step_scale: jax.Array
    tree: KinematicTree
    flesh: Superquadrics


@lru_cache(maxsize=8)
def image_programs(
    kind: Kind = "full", settings: CostSettings | None = None, *, limits: Limits = "support", parts: bool = True
) -> StateSpaceModel:
    """Write the programs; their inputs are :class:`CostInputs`.

    Args:
        kind: Which body.
        settings: The cost's numbers; the usual ones if None.
        limits: "support" limits the sites; "barrier" leaves them free and adds a smooth log-factor.
        parts: Whether parts are kept out of each other.
    """
    body, chosen = superquadric_body(kind), settings or CostSettings()
    repelled = non_penetration_residuals(body.flesh.names)

    def observe(params: Any, pose: jax.Array, inputs: CostInputs) -> None:
        arguments = (inputs.tree, inputs.flesh, inputs.cameras, pose, inputs.seen, inputs.noise)
        numpyro.sample("image", ContourAndFlow(*arguments, chosen))
        if parts:
            numpyro.sample("parts", dist.Normal(repelled(pose, inputs.tree, inputs.flesh), 1.0))

    return limited_body(body, limits, observe)


def seen_in_images(
    images: Images, previous: Any, before: Images | None = None, *, settings: EnergySettings | None = None
) -> ImageSeen:
    """Take edge energy, flow and motion boundaries from a frame.

    Args:
        images: Of C cameras, all of one size, (H, W, 3) RGB or (H, W) gray.
        previous: The pose in the frame before (d,), at which the flow starts; any pose where there is no such frame.
        before: The images of the frame before; None for none, and then there is no flow, and every edge counts as one at a
            motion boundary.
        settings: Of the edge energy.
    """
    energy = np.stack([edge_energy(image, settings) for image in images])
    boundary, trust = np.ones_like(energy), np.zeros_like(energy)
    flow = np.zeros((len(energy), 2, *energy.shape[1:]), np.float32)
    if before is not None:
        for number, (first, second) in enumerate(zip(before, images, strict=True)):
            forth, back = dense_flow(first, second, "dis_medium"), dense_flow(second, first, "dis_medium")
            flow[number] = np.moveaxis(forth, 2, 0)
            trust[number] = 1.0 - flow_outliers(forth, back)
            boundary[number] = motion_boundaries(flow_outliers(back, forth), settings)
    arrays = energy, boundary, flow, trust, np.ones(len(energy)), previous
    return ImageSeen(*(jnp.asarray(each, float) for each in arrays))


def cost_noise(cameras: int = 1, *, edges: float = 2.0, flow: float = 1.5, weight: float = 8.0) -> CostNoise:
    """Noise of cameras that are all alike: standard deviations (px) of edges and flow, and the weight of each."""
    return CostNoise(*(jnp.full(cameras, value) for value in (edges, flow, weight)))


def cost_data(program: StateSpaceModel, inputs: CostInputs) -> dict[str, NDArray[Any]]:
    """The data of a frame by site: all residuals are 0."""
    compiled = program.compile(inputs, {})
    return {name: np.zeros(site.shape) for name, site in compiled.observation_sites.items()}
