"""The body and the likelihood of Du and Guan (ICASSP 2006, section 3): silhouettes, colours and boundaries of 14 segments.

It is a product of three functions of the image (G) and of the projected body (H):

    p_1 = |S_G and S_H| / |S_G or S_H|,    p_2 = exp(-d(C_G, C_H) / s_2),    p_3 = exp(-|B_G - B_H| / s_3),

S being silhouettes, C colour histograms with their weighted Bhattacharyya distance d, sqrt(1 - sum_r w_r rho_r) of the overlaps
rho_r of parts with their shares w_r, and B Fourier descriptors of boundaries. The paper says "their ratio" of the overlap, and
takes the two distances as densities, which grow with the resemblance of nothing; the ratio to the union and exponentials are
chosen here. So s_2 and s_3 are temperatures of the distances: ``params["colour_scale"]`` and ``params["boundary_scale"]``; p_1
is taken to the power 1 / s_1, ``params["overlap_scale"]``, as it stands at 1.

Colours are those at a grid of known pixels of each part. If n_b of the n pixels are in bin b, each of them adds sqrt(q_b / (n
n_b)) to the overlap of the part's histogram with the target q. This needs no histogram. A part that another one hides shows
that one's colours: the weights of parts are the caller's. If no part is seen, d = 1. Boundaries are traced on the grid of the
silhouettes (:mod:`poseppl_models.du_guan.evidence`). If the image has none, p_3 = 1; if the body has none, its
descriptors are 0. p_1 is at least 1e-6.

Six for the place and orientation of the root. The paper does not say which the others are, nor which segments are spheres;
chosen here: 2 for the head (nodding and turning), 3 for shoulders and hips, 1 for elbows and knees; torso and head, upper
arms, forearms and hands, thighs, shanks and feet. All are truncated cones: what it draws as spheres are short wide cones
here.

>>> body = du_guan_body()
>>> body.tree.dimension, len(body.flesh.names)
(24, 14)
"""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.batch_last import computed_once
from poseppl_models.bodies.anthropometry import STATURE
from poseppl_models.bodies.cone_body import ConeBody, proportional_body
from poseppl_models.du_guan.evidence import GRID, DuGuanEvidence, grid_descriptors
from poseppl_models.images.image_program import CameraScore, SeenBody
from poseppl_models.images.part_samples import index_at, inside_points
from poseppl_models.images.silhouette_bits import count_ones

_MIN_OVERLAP = 1e-6


def du_guan_score(stride: int) -> CameraScore:
    """Write log p_1 p_2 p_3 for each camera, without a gradient.

    Args:
        stride: Stride of the evidence's grid, px.
    """

    def score(seen: SeenBody) -> Array:
        evidence: DuGuanEvidence = seen.evidence
        corners = computed_once(seen.corners())
        body = computed_once(seen.silhouette(stride))
        overlap = overlap_ratio(evidence.foreground & evidence.known, body)
        colour = colour_distance(evidence, corners)
        boundary = boundary_distance(evidence.descriptors, body)
        exponent = colour / seen.params["colour_scale"] + boundary / seen.params["boundary_scale"]
        return jnp.log(jnp.maximum(overlap, _MIN_OVERLAP)) / seen.params["overlap_scale"] - exponent

    return score


def overlap_ratio(image: Array, body: Array) -> Array:
    """Points of both over points of any (C, N), for words (C, rows, words, N or 1); 0 where there are none."""
    return count_ones(image & body) / jnp.maximum(count_ones(image | body), 1)


def colour_distance(evidence: DuGuanEvidence, corners: Array) -> Array:
    """Weighted Bhattacharyya distance (C, N) of the colours inside of outlines (C, P, 4, 2, N)."""
    bins = computed_once(index_at(evidence.bins[..., 0], *inside_points(corners, *GRID)))  # (C, P, K, N)
    seen = bins >= 0
    alike = sum((bins == bins[:, :, k, None]).astype(jnp.int32) for k in range(bins.shape[2]))
    number = jnp.sum(seen, 2, keepdims=True)
    cameras, parts, size = evidence.colours.shape[:3]
    first = (jnp.arange(cameras * parts, dtype=jnp.int32) * size).reshape(cameras, parts, 1, 1)
    sought = jnp.take(evidence.colours.reshape(-1), first + jnp.maximum(bins, 0), mode="clip")
    terms = jnp.where(seen, jnp.sqrt(sought / jnp.maximum(alike * number, 1)), 0.0)
    weights = jnp.where(number[:, :, 0] > 0, evidence.part_weights, 0.0)
    total = jnp.sum(weights, 1)
    overlap = jnp.sum(weights * jnp.sum(terms, 2), 1) / jnp.where(total > 0, total, 1.0)
    return jnp.sqrt(jnp.clip(1 - overlap, 0.0, 1.0))


def boundary_distance(descriptors: Array, body: Array) -> Array:
    """Euclidean distance (C, N) between descriptors (C, count, 1) and those of words (C, rows, words, N)."""
    found = grid_descriptors(body)
    there = jnp.isfinite(descriptors)
    return jnp.sqrt(jnp.sum(jnp.where(there, (found - jnp.where(there, descriptors, 0.0)) ** 2, 0.0), 1))


AXES = {"pelvis": "ZYX", "neck": "ZX", "shoulder": "ZYX", "elbow": "X", "hip": "ZYX", "knee": "X"}


def du_guan_body(stature: float = STATURE, lengths: Mapping[str, float] | None = None) -> ConeBody:
    """Build the body of a person so tall (mm); segments whose lengths (mm) were measured take these."""
    return proportional_body(stature, lengths, AXES, ("upper_arm", "forearm", "hand", "thigh", "shank", "foot"))
