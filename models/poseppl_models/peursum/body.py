"""The body and the likelihood of Peursum, Venkatesh and West (2010, section 3.4): 28 dimensions, edges and foreground.

doi:10.1007/s11263-009-0205-5.

Position and heading of the root, and 24 rotations, the pitch of the body among them. Each part is a cylinder and fits
loosely, so that one body serves all sorts of people and clothes. The paper shows the parts in a drawing and gives no sizes;
chosen here: pitch, bends and turns at the waist (3), a nodding and turning head (2), three turns at shoulders and hips, one
at elbows, knees and ankles; 12 cylinders, the hands being part of the forearms; thicknesses a quarter more than the body's
own.

>>> body = peursum_body()
>>> body.tree.dimension, len(body.flesh.names)
(28, 12)

The likelihood has a distance D >= 0 between an image and the projected body, and an exponential distribution of it (Eqs. 8 and
9):

    P(y | x) = lambda exp(-lambda D),    log P = log lambda - lambda D for each camera.

lambda is the inverse temperature (Eqs. 10 and 11): annealing e^-D to the power lambda is the same up to a constant. The
paper uses 8 with its learned motion model and 10 with the generic one.

D is "a modified version of the cost function of Deutscher and Reid", whose details the paper leaves to a report. Here it is
that function, a sum of a mean error of edges and one of the foreground, in both directions. Evidence that a body leaves
unexplained counts as much as evidence that it claims wrongly:

    D = (E_body + E_image) / 2 + (F_body + F_image) / 2,

* F_body: share of the body's silhouette outside of the foreground;
* F_image: share of the foreground that the body does not cover;
* E_body: share of the parts' sides, by length, without an edge;
* E_image: share of the image's edges without a side of a part within a tolerance.

Each share is in [0, 1] and over the known pixels; it is 0 if there are none. So hidden pixels are no evidence, and a body
cannot gain by leaving the image, because all of the foreground is then unexplained. Foreground is counted on a grid of pixels
(:mod:`poseppl_models.images.silhouette_bits`), edges at fixed numbers of samples.
"""

from __future__ import annotations

from functools import reduce

import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.batch_last import computed_once
from poseppl.motion.geometry.coverage import part_distances, project_parts, soft_coverage
from poseppl_models.bodies.anthropometry import STATURE, segment_lengths, segment_radii
from poseppl_models.bodies.cone_body import ConeBody, cone_body, limb_cones, trunk_cones
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

LOOSENESS = 1.25
"""By how much cylinders are thicker than the segments within."""
SHORT_HAND = 0.5
"""Share of the hand that lengthens the forearm."""
AXES = {"pelvis": "ZX", "thorax": "ZYX", "neck": "ZX", "shoulder": "ZYX", "elbow": "X", "hip": "ZYX", "knee": "X", "ankle": "X"}


def peursum_body(scale: float = 1.0) -> ConeBody:
    """Build the body.

    Args:
        scale: Scale of the whole body, 1 for a stature of 1.75 m.
    """
    lengths = segment_lengths(scale * STATURE)
    middles = {name: LOOSENESS * sum(pair) / 2 for name, pair in segment_radii(scale * STATURE).items()}
    radii = {name: (radius, radius) for name, radius in middles.items()}
    reach = {**lengths, "forearm": lengths["forearm"] + SHORT_HAND * lengths["hand"]}
    limbs = limb_cones(reach, radii, ("upper_arm", "forearm", "thigh", "shank", "foot"))
    return cone_body(lengths, AXES, [*trunk_cones(lengths, radii), *limbs])


SIDE_SAMPLES = 8
"""Samples along a side: one every 5 to 15 px for limbs of 40 to 120 px."""
GRID = (8, 4)
"""Rows and columns of samples inside a part, for the smooth distance."""


def peursum_score(stride: int, tolerance: float = 3.0) -> CameraScore:
    """Write log P of each camera, for samplers that need no gradient; ``params["lambda"]`` is the exponent.

    Args:
        stride: Stride of the evidence's grid, px.
        tolerance: Within how many px an edge of the image is explained.
    """

    def score(seen: SeenBody) -> Array:
        evidence: TwoWayEvidence = seen.evidence
        corners = computed_once(seen.corners())
        near = squared_distance(evidence.edge_points, corners) <= tolerance**2
        edge_image = _mean(jnp.where(near, 0.0, 1.0), evidence.edge_weights)
        edge_body = weighted_mean(
            nearest(evidence.edge_error[..., 0], *side_points(corners, SIDE_SAMPLES)), side_lengths(corners)[:, :, :, None], 0.0
        )
        body = seen.silhouette(stride)
        both, claimed = count_ones(body & evidence.foreground), count_ones(body)
        there = count_ones(evidence.foreground & evidence.known)
        inside_body, inside_image = _missing(both, claimed), _missing(both, there)
        return exponential(seen.params["lambda"], (edge_body + edge_image + inside_body + inside_image) / 2)

    return score


def smooth_peursum_score(softness: float = 2.0, tolerance: float = 3.0) -> CameraScore:
    """Write log P of each camera for a smooth D, for methods that need a gradient.

    The silhouette is sampled inside the parts and at points of the foreground, with the smooth coverage of
    :mod:`poseppl.motion.geometry.coverage`; maps are interpolated; an edge at the distance d from a side is explained by
    exp(-d^2 / (2 tolerance^2)).

    Args:
        softness: Softness of the coverage, px.
        tolerance: Tolerance of the edges, px.
    """

    def score(seen: SeenBody) -> Array:
        evidence: TwoWayEvidence = seen.evidence
        corners = seen.corners()
        squared = squared_distance(evidence.edge_points, corners)
        edge_image = _mean(1 - jnp.exp(-squared / (2 * tolerance**2)), evidence.edge_weights)
        sides, inside = side_points(corners, SIDE_SAMPLES), inside_points(corners, *GRID)
        edge_body = weighted_mean(bilinear(evidence.edge_error[..., 0], *sides), side_lengths(corners)[:, :, :, None], 0.0)
        inside_body = weighted_mean(bilinear(evidence.inside_error[..., 0], *inside), areas(corners)[:, :, None], 0.0)
        distances = part_distances(project_parts(seen.cameras, seen.flesh, seen.parts), evidence.foreground_points)
        uncovered = jnp.exp(soft_coverage(distances, jnp.full((seen.cameras.centre.shape[0], 1), softness)))
        inside_image = _mean(uncovered, evidence.foreground_weights)
        return exponential(seen.params["lambda"], (edge_body + edge_image + inside_body + inside_image) / 2)

    return score


def exponential(rate: Array, distance: Array) -> Array:
    """Log-density (C, N) of an exponential distribution (Eq. 9) of distances (C, N)."""
    return jnp.log(rate) - rate * distance


def _missing(both: Array, whole: Array) -> Array:
    """1 - both / whole, 0 where there is no whole."""
    return jnp.where(whole > 0, 1 - both / jnp.maximum(whole, 1), 0.0)


def _mean(values: Array, weights: Array) -> Array:
    """Mean (C, N) of values (C, K, N) at points with weights (C, K, 1); 0 without weight."""
    total = jnp.sum(weights, 1)
    return jnp.where(total > 0, jnp.sum(values * weights, 1) / jnp.where(total > 0, total, 1.0), 0.0)


_TINY = 1e-12


def squared_distance(points: Array, corners: Array) -> Array:
    """Squared distance (C, K, N) in px of points (C, K, 2, N or 1) from the nearest side of any part.

    Args:
        points: Image points.
        corners: Outlines (C, P, 4, 2, N), of which the first and the second two are the ends of a side.
    """
    starts, ends = (corners[:, :, end::2].reshape(corners.shape[0], -1, 2, corners.shape[-1]) for end in range(2))
    way = ends - starts
    step = computed_once(way / (jnp.sum(way**2, 2, keepdims=True) + _TINY))
    x, y = points[:, :, 0], points[:, :, 1]

    def from_side(side: int) -> Array:
        dx, dy = x - starts[:, side, None, 0], y - starts[:, side, None, 1]
        along = jnp.clip(dx * step[:, side, None, 0] + dy * step[:, side, None, 1], 0.0, 1.0)
        return (dx - along * way[:, side, None, 0]) ** 2 + (dy - along * way[:, side, None, 1]) ** 2

    return reduce(jnp.minimum, (from_side(side) for side in range(starts.shape[1])))
