"""The body of Darby, Li and Costen (2008, doi:10.1109/AFGR.2008.4813348, section 3) and its likelihood (section 6.1).

"Position and orientation of the torso and the relative joint angles between limbs": 6 for the pelvis; the paper leaves the
other 25 to its references. Taken here as in the software of Balan, Sigal and Black (2005) that its results are compared
with: 2 between pelvis and thorax, 3 for the neck, 2 for each clavicle, 3 for shoulders and hips, 1 for elbows and knees.
Hands and feet have no cones.

>>> body = darby_body()
>>> body.tree.dimension, len(body.flesh.names)
(31, 10)

With several cameras (Eq. 8), V being a map of the silhouette or of the proximity to an edge, both in [0, 1], and xi sample
points on the cones' surfaces or edges,

    -log p(z | x) = beta sum over both maps of (1 / |xi|) sum over xi of (1 - V(xi))^2.

With a single one the edges are left out, and the error is divided by W (Eq. 9), which falls as the silhouettes' sizes differ:

    W = (1 - |g_z - g_x| / max(g_z, g_x))^gamma,

g being the ratio of foreground to background pixels of the image (z) and of the projected body (x); gamma = 0 is W = 1, and
the paper uses 5. The paper gives -log p up to a factor, which annealing sets: here it is ``beta``, the inverse temperature
at which the mean squared errors are a negative log-density.

The weight of a sample is the length of the side or the area of the cell that it represents. Samples that are unknown, or
outside of the image, have no weight. If no sample has weight, the mean error is 1, the largest, so that leaving the image has
no advantage. W's ratios are over the known pixels of a grid, and W is at least 1e-6.
"""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.batch_last import computed_once
from poseppl_models.bodies.anthropometry import STATURE
from poseppl_models.bodies.cone_body import ConeBody, proportional_body
from poseppl_models.images.evidence import TwoWayEvidence
from poseppl_models.images.image_program import CameraScore, SeenBody
from poseppl_models.images.part_samples import (
    areas,
    bilinear,
    inside_points,
    nearest,
    side_lengths,
    side_points,
    weighted_mean,
)
from poseppl_models.images.silhouette_bits import count_ones

AXES = {
    "pelvis": "ZYX",
    "thorax": "ZX",
    "neck": "ZYX",
    "clavicle": "ZY",
    "shoulder": "ZYX",
    "elbow": "X",
    "hip": "ZYX",
    "knee": "X",
}


def darby_body(stature: float = STATURE, lengths: Mapping[str, float] | None = None) -> ConeBody:
    """Build the body of a person so tall (mm); segments whose lengths (mm) were measured take these."""
    return proportional_body(stature, lengths, AXES, ("upper_arm", "forearm", "thigh", "shank"))


SIDE_SAMPLES = 8
GRID = (8, 4)
"""Rows and columns of samples inside a part."""
_MIN_WEIGHT = 1e-6


def darby_score(*, smooth: bool = False) -> CameraScore:
    """Write Eq. 8 for each camera; ``params["beta"]`` is the inverse temperature.

    The evidence's ``inside_error`` and ``edge_error`` hold (1 - V)^2.

    Args:
        smooth: Whether maps are interpolated between pixels, which gives a gradient.
    """

    def score(seen: SeenBody) -> Array:
        evidence: TwoWayEvidence = seen.evidence
        corners = _barrier(seen.corners(), smooth)
        look_up = bilinear if smooth else nearest
        sides = look_up(evidence.edge_error[..., 0], *side_points(corners, SIDE_SAMPLES))
        on_sides = weighted_mean(sides, side_lengths(corners)[:, :, :, None], 1.0)
        return -seen.params["beta"] * (on_sides + _inside(corners, evidence, smooth))

    return score


def darby_monocular_score(stride: int) -> CameraScore:
    """Write Eqs. 8 and 9 for silhouettes alone; ``params`` has the inverse temperature ``beta`` and the exponent ``gamma``.

    It has no gradient: the silhouette's size is counted.

    Args:
        stride: Stride of the evidence's grid, px.
    """

    def score(seen: SeenBody) -> Array:
        evidence: TwoWayEvidence = seen.evidence
        corners = _barrier(seen.corners(), False)
        known = count_ones(evidence.known)
        image = _ratio(count_ones(evidence.foreground & evidence.known), known)
        body = _ratio(count_ones(seen.silhouette(stride)), known)
        weight = size_weight(image, body, seen.params["gamma"])
        return -seen.params["beta"] * _inside(corners, evidence, False) / weight

    return score


def size_weight(image: Array, body: Array, gamma: Array) -> Array:
    """W of Eq. 9 for two ratios of foreground to background; 1 where both are 0."""
    largest = jnp.maximum(image, body)
    disparity = jnp.abs(image - body) / jnp.where(largest > 0, largest, 1.0)
    return jnp.maximum((1 - disparity) ** gamma, _MIN_WEIGHT)


def _inside(corners: Array, evidence: TwoWayEvidence, smooth: bool) -> Array:
    found = (bilinear if smooth else nearest)(evidence.inside_error[..., 0], *inside_points(corners, *GRID))
    return weighted_mean(found, areas(corners)[:, :, None], 1.0)


def _ratio(foreground: Array, known: Array) -> Array:
    return foreground / jnp.maximum(known - foreground, 1)


def _barrier(corners: Array, smooth: bool) -> Array:
    """Compute corners once, not again for every sample; the smooth ones are left to the compiler, which differentiates them."""
    return corners if smooth else computed_once(corners)
