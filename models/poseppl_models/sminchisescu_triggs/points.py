"""Bodies of Sminchisescu and Triggs (2001) seen as points, with each of the paper's priors and robustness as a setting.

The ingredients that the paper finds essential are optional here: robust errors, joint limits, and parts that do not penetrate
each other. Robust errors are an input, so that one compiled program serves with and without them. The points replace the
paper's images: a wrongly detected joint is an outlier, like an edge of the background.

>>> point_programs("arm") is point_programs("arm") is not point_programs("arm", limits="none")
True
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.program import Lorentzian, StateSpaceModel
from poseppl_models.sminchisescu_triggs.body import Kind, superquadric_body
from poseppl_models.sminchisescu_triggs.marker_body import Limits, limited_body
from poseppl_models.sminchisescu_triggs.non_penetration import non_penetration_residuals
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics

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
