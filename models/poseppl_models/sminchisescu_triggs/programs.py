"""Programs of the bodies of Sminchisescu and Triggs (2001), seen in images or as points, with the priors of section 3.2.

The state and its walk within joint limits and about equilibria are those of
:mod:`poseppl_models.sminchisescu_triggs.marker_body`. In images a frame's data are residuals whose value is 0, ``image`` of
the cost (:mod:`poseppl_models.sminchisescu_triggs.likelihood`) and ``parts`` of parts that run through each other
(:mod:`poseppl_models.sminchisescu_triggs.non_penetration`): both have gradients and Gauss-Newton curvature.

Flow compares with the frame before, and so with a pose then, that comes by the inputs (``seen.previous``): a tracker gives its
estimate. The programs' own transition knows nothing of it, and so flow keeps a limb that is lost where it is: what the image
says of motion there is that there is none. Edges of coarser levels (``levels``) pull from as far as their smoothing goes.

The ingredients that the paper finds essential are optional here: robust errors, joint limits, and parts that do not penetrate
each other. Robust errors are an input, so that one compiled program serves with and without them. The points replace the
paper's images: a wrongly detected joint is an outlier, like an edge of the background.

>>> point_programs("arm") is point_programs("arm") is not point_programs("arm", limits="none")
True
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
from jax import Array
from numpy.typing import NDArray

from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.motion.vision import (
    EnergySettings,
    dense_flow,
    edge_energy,
    flow_outliers,
    flow_weights,
    motion_boundaries,
)
from poseppl.program import Lorentzian, StateSpaceModel
from poseppl_models.sminchisescu_triggs.body import Kind, superquadric_body
from poseppl_models.sminchisescu_triggs.cost import CostNoise, CostSettings, ImageSeen
from poseppl_models.sminchisescu_triggs.likelihood import ContourAndFlow
from poseppl_models.sminchisescu_triggs.marker_body import Limits, limited_body
from poseppl_models.sminchisescu_triggs.non_penetration import non_penetration_residuals
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics

Images = Sequence[NDArray[Any]]
Levels = Sequence[float]


@lru_cache(maxsize=8)
def image_programs(kind: Kind = "full", *, parts: bool = True) -> StateSpaceModel:
    """Write the programs; in their inputs ``seen`` is an :class:`ImageSeen` and ``noise`` a :class:`CostNoise`.

    Args:
        kind: Which body.
        parts: Whether parts are kept out of each other.
    """
    body, settings = superquadric_body(kind), CostSettings()
    repelled = non_penetration_residuals(body.flesh.names)

    def observe(params: Any, pose: Array, inputs: BodyInputs) -> None:
        arguments = (inputs.tree, inputs.flesh, inputs.cameras, pose, inputs.seen, inputs.noise)
        numpyro.sample("image", ContourAndFlow(*arguments, settings))
        if parts:
            numpyro.sample("parts", dist.Normal(repelled(pose, inputs.tree, inputs.flesh), 1.0))

    return limited_body(body, "support", observe)


def seen_in_images(images: Images, previous: Any, before: Images | None = None, *, levels: Levels = (1.0,)) -> ImageSeen:
    """Take edge energy, flow and motion boundaries from a frame.

    Args:
        images: Images of C cameras, all of one size, (H, W, 3) RGB or (H, W) gray.
        previous: The pose in the frame before (d,), at which the flow starts; any pose where there is no such frame.
        before: The images of the frame before; None for none, and then there is no flow, and every edge counts as one at a
            motion boundary.
        levels: Levels of a pyramid: multiples of the smoothing at which edges are taken. Each camera has a row for each of L
            levels, and flow at the first.
    """
    settings = EnergySettings()
    energy = np.stack([edge_energy(image, settings.at_level(level)) for image in images for level in levels])
    boundary, trust = np.ones_like(energy), np.zeros((len(energy), 3, *energy.shape[1:]), np.float32)
    flow = np.zeros((len(energy), 2, *energy.shape[1:]), np.float32)
    for number, (first, second) in enumerate(zip(before or (), images, strict=before is not None)):
        row, rows = number * len(levels), slice(number * len(levels), (number + 1) * len(levels))
        forth, back = dense_flow(first, second, "dis_medium"), dense_flow(second, first, "dis_medium")
        flow[row] = np.moveaxis(forth, 2, 0)
        trust[row] = flow_weights(first, second, forth, flow_outliers(forth, back))
        boundary[rows] = motion_boundaries(flow_outliers(back, forth), back, settings)
    arrays = energy, boundary, flow, trust, np.ones(len(energy)), previous
    return ImageSeen(*(jnp.asarray(each, float) for each in arrays))


def at_levels(cameras: Cameras, levels: Levels) -> Cameras:
    """Each of C cameras once for each of L levels: the cameras of :func:`seen_in_images`."""
    repeated: Cameras = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), len(levels), 0), cameras)
    return repeated


def cost_noise(*, edges: float = 2.0, flow: float = 1.5, weight: float = 8.0, levels: Levels = (1.0,)) -> CostNoise:
    """Noise of one camera.

    Args:
        edges: Standard deviation of edges, px at the first level; in proportion to the smoothing at the others.
        flow: Standard deviation of flow, px.
        weight: At each level.
        levels: As in :func:`seen_in_images`.
    """
    spread = edges * jnp.asarray(levels, float) / levels[0]
    return CostNoise(spread, *(jnp.full(len(levels), value) for value in (flow, weight)))


STRENGTH = 4.0
"""nu of the Lorentzian; it has to exceed 2, the size of an image point."""
GAUSSIAN = 1e5
"""nu at which it is a Gaussian: at 27 standard deviations, 711 of squared error, rho is 708."""


class RobustPointInputs(NamedTuple):
    """Inputs of one frame.

    Attributes:
        cameras: C cameras.
        noise: Standard deviation of the image noise (C, markers), in image units.
        start: Mean of the first state (d,).
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,), mm and radians.
        tree: The person's own tree.
        flesh: The person's own flesh.
        strength: nu of the points' Lorentzian errors, a scalar.
    """

    cameras: Cameras
    noise: Array
    start: Array
    start_scale: Array
    step_scale: Array
    tree: KinematicTree
    flesh: Superquadrics
    strength: Array


@lru_cache(maxsize=16)
def point_programs(kind: Kind = "full", *, limits: Limits = "support", parts: bool = True) -> StateSpaceModel:
    """Write the programs; data are ``points`` (C, markers, 2), and ``parts``, which are 0, where parts are kept apart.

    Args:
        kind: Which body.
        limits: "support" limits the sites; "barrier" adds a smooth log-factor; "none" leaves joints free.
        parts: Whether parts are kept out of each other, which on a whole body takes most of the time.
    """
    body = superquadric_body(kind)
    repelled = non_penetration_residuals(body.flesh.names)

    def observe(params: Any, pose: Array, inputs: RobustPointInputs) -> None:
        points = ProjectedMarkers(inputs.tree, inputs.cameras, pose, inputs.noise)
        numpyro.sample("points", Lorentzian(points.to_event(1), inputs.strength))
        if parts:
            residuals = repelled(pose, inputs.tree, inputs.flesh)
            numpyro.sample("parts", dist.Normal(residuals, jnp.ones_like(residuals)))

    return limited_body(body, limits, observe)


def point_inputs(*known: Any, robust: bool = True) -> RobustPointInputs:
    """Inputs of a frame, the fields of :class:`RobustPointInputs` up to the flesh being given.

    Args:
        known: Cameras, noise, start, start_scale, step_scale, tree and flesh.
        robust: Whether errors are Lorentzian; otherwise Gaussian.
    """
    return RobustPointInputs._make((*known, jnp.asarray(STRENGTH if robust else GAUSSIAN, float)))
