"""Evidence that the likelihood of Du and Guan takes from the images of a frame, and the colours of a body at a known pose."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.compilation import jit
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.flesh import parts_of
from poseppl.motion.geometry.outlines import outline_corners
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.du_guan.contour_tracing import polygon_descriptors, trace_contours
from poseppl_models.images.part_samples import index_at, inside_points
from poseppl_models.images.silhouette_bits import pack_mask

Images = NDArray[Any]
GRID = (6, 4)
"""Rows and columns of the pixels of a part whose colours are looked up."""
DESCRIPTORS = 20
_MAX_CORNERS = 256
"""Room for the corners of a contour, of which there is one every 4 steps of the grid."""


class DuGuanEvidence(NamedTuple):
    """Evidence of C cameras.

    Attributes:
        foreground: Words of the grid's foreground (C, rows, words), uint32.
        known: Words of where there is evidence.
        bins: Bin of each pixel's colour, negative without evidence, padded (C, H + 1, W), int32.
        colours: Histograms of the parts that are sought (C, P, bins), shares.
        part_weights: Weight of each part's colours (C, P).
        descriptors: Fourier descriptors of the foreground's contour (C, count); NaN for none, and then contours do not count.
    """

    foreground: Array
    known: Array
    bins: Array
    colours: Array
    part_weights: Array
    descriptors: Array


def du_guan_evidence(
    foreground: Images,
    known: Images,
    bins: Images,
    colours: Images,
    part_weights: Images,
    *,
    stride: int = 4,
) -> DuGuanEvidence:
    """Take the evidence of a frame from its features and colours; contours are those on the grid, where thin gaps close.

    Args:
        foreground: (C, H, W), not 0 at the person.
        known: (C, H, W), not 0 where a pixel is evidence.
        bins: (C, H, W) bins of colours.
        colours: (C, P, bins) histograms of the parts, such as :func:`part_colours` of a frame whose pose is known.
        part_weights: (C, P) weights of the parts.
        stride: Pixels between points of the grid.
    """
    there = np.asarray(known, bool)
    shown, seen = pack_mask(foreground, stride), pack_mask(there, stride)
    found = np.asarray(jit(grid_descriptors)((shown & seen)[..., None]))[..., 0]
    descriptors = np.where(np.any(np.asarray(shown & seen), axis=(1, 2))[:, None], found, np.nan)
    floats = (jnp.asarray(values, float) for values in (colours, part_weights, descriptors))
    return DuGuanEvidence(shown, seen, pad_bins(bins, there), *floats)


def grid_descriptors(bits: Array) -> Array:
    """Fourier descriptors (C, DESCRIPTORS, N) of silhouettes (C, rows, words, N); 0 for an empty one."""
    cameras = bits.shape[0]
    contours = trace_contours(jnp.moveaxis(bits, 0, 2).reshape(*bits.shape[1:3], -1), _MAX_CORNERS)
    found = polygon_descriptors(contours.x.astype(float), contours.y.astype(float), DESCRIPTORS)
    return jnp.moveaxis(found.reshape(DESCRIPTORS, cameras, -1), 1, 0)


def pad_bins(bins: Images, known: Images) -> Array:
    """Bins (C, H, W), -1 where a pixel is no evidence, with one more row of -1: (C, H + 1, W), int32."""
    marked = np.where(known, bins, -1)
    return jnp.asarray(np.pad(marked, ((0, 0), (0, 1), (0, 0)), constant_values=-1), jnp.int32)


def part_colours(body: ConeBody, state: Any, cameras: Cameras, bins: Array, num_bins: int) -> Images:
    """Count the colours (C, P, num_bins) of a body's parts in a known state (d,), from padded bins (C, H + 1, W)."""
    tree, flesh, one, view = jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], (body.tree, body.flesh, state, cameras))
    points = inside_points(outline_corners(view, flesh, parts_of(tree, flesh, jnp.asarray(one, float))), *GRID)
    found = np.asarray(index_at(bins, *points))[..., 0]
    counts = np.stack([np.sum(found == number, -1) for number in range(num_bins)], -1)
    shares: Images = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    return shares
