"""Evidence of the published likelihoods, from the images or the features of a frame to arrays of fixed sizes.

Errors of edges are (1 - proximity)^2, as in Eq. 8 of Darby, Li and Costen (2008) and in the cost of Deutscher and Reid (2005)
that Peursum, Venkatesh and West (2010, section 3.4) build on; those of silhouettes are 0 and 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.motion.geometry import Cameras
from poseppl.motion.vision import ColourSettings, FrameFeatures, colour_bins
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.du_guan.evidence import DuGuanEvidence, du_guan_evidence, pad_bins, part_colours
from poseppl_models.images.part_samples import pad_maps
from poseppl_models.images.silhouette_bits import grid_points, pack_mask

Images = NDArray[Any]


def two_way_of_features(features: Sequence[FrameFeatures], *, stride: int = 4) -> TwoWayEvidence:
    """Take the evidence of silhouettes and edges of a frame.

    Args:
        features: Features of C cameras, all of one size.
        stride: Pixels between points of the grid.
    """
    near = np.stack([each.edge_proximity for each in features]).astype(np.float64)
    shown, edges, known = (
        np.stack(maps) for maps in zip(*((f.foreground, f.edges, f.ignore == 0) for f in features), strict=True)
    )
    return two_way_evidence(shown, edges, known, stride=stride, edge_error=(1 - near) ** 2)


def colours_at(
    body: ConeBody, state: Any, cameras: Cameras, features: Sequence[FrameFeatures], images: Sequence[Images]
) -> Images:
    """Colours (C, P, bins) of a body's parts in a frame whose pose (d,) is known, from images (H, W, 3)."""
    known = np.stack([each.ignore == 0 for each in features])
    bins = pad_bins(np.stack([colour_bins(image) for image in images]), known)
    return part_colours(body, state, cameras, bins, ColourSettings().bins)


def du_guan_of_features(
    features: Sequence[FrameFeatures], images: Sequence[Images], colours: Images, *, stride: int = 4
) -> DuGuanEvidence:
    """Take the evidence of silhouettes, colours and boundaries of a frame; all parts have weight 1.

    Args:
        features: Features of C cameras, all of one size.
        images: (H, W, 3) RGB of each.
        colours: Target colours (C, P, bins), from :func:`colours_at`.
        stride: Pixels between points of the grid.
    """
    shown, known = (np.stack(maps) for maps in zip(*((f.foreground, f.ignore == 0) for f in features), strict=True))
    bins = np.stack([colour_bins(image) for image in images])
    return du_guan_evidence(shown, known, bins, colours, np.ones(colours.shape[:2]), stride=stride)


POINTS = 150
"""Points of the foreground, and of the edges, of each camera."""


class TwoWayEvidence(NamedTuple):
    """Evidence of C cameras.

    Attributes:
        foreground: Words of the grid's foreground (C, rows, words), uint32.
        known: Words of where there is evidence.
        inside_error: Error of a pixel of the silhouette in [0, 1], negative without evidence, padded (C, H + 1, W).
        edge_error: Error of a pixel of an outline, likewise.
        foreground_points: Pixels of the foreground (C, K, 2), px.
        foreground_weights: Their weights (C, K), 0 for those that are only there to fill up.
        edge_points: Pixels on edges (C, K, 2), px.
        edge_weights: Their weights (C, K).
    """

    foreground: Array
    known: Array
    inside_error: Array
    edge_error: Array
    foreground_points: Array
    foreground_weights: Array
    edge_points: Array
    edge_weights: Array


def two_way_evidence(
    foreground: Images,
    edges: Images,
    known: Images,
    *,
    stride: int = 4,
    inside_error: Images | None = None,
    edge_error: Images | None = None,
) -> TwoWayEvidence:
    """Take the evidence of a frame from its features, of :func:`poseppl.motion.vision.extract`.

    Args:
        foreground: (C, H, W), not 0 at the person.
        edges: (C, H, W), not 0 at an edge.
        known: (C, H, W), not 0 where a pixel is evidence; 0 at occluders that may hide the person.
        stride: Pixels between points of the grid.
        inside_error: (C, H, W) in [0, 1]; None for 1 - foreground.
        edge_error: (C, H, W) in [0, 1], such as 1 - proximity; None for 1 - edges.
    """
    shown, here, there = (np.asarray(image) != 0 for image in (foreground, edges, known))
    errors = (1.0 - shown if inside_error is None else inside_error, 1.0 - here if edge_error is None else edge_error)
    inside_map, edge_map = (pad_maps(jnp.asarray(np.where(there, error, -1.0), float)) for error in errors)
    (inside_points, inside_weights), (edge_points, edge_weights) = (_spread(mask & there) for mask in (shown, here))
    return TwoWayEvidence(
        pack_mask(shown, stride),
        pack_mask(there, stride),
        inside_map,
        edge_map,
        inside_points,
        inside_weights,
        edge_points,
        edge_weights,
    )


def _spread(masks: Images, count: int = POINTS) -> tuple[Array, Array]:
    """Points (C, count, 2) of masks (C, H, W) and their weights (C, count): evenly among those of a grid as fine as need be."""
    points, weights = np.zeros((len(masks), count, 2)), np.zeros((len(masks), count))
    for camera, mask in enumerate(masks):
        stride = max(1, int(np.sqrt(mask.sum() / (8 * count))))
        rows, columns = (grid_points(size, stride) for size in mask.shape)
        found = np.argwhere(mask[np.ix_(rows, columns)])
        if len(found):
            kept = found[((np.arange(count) + 0.5) * len(found) / count).astype(int)] if len(found) > count else found
            points[camera, : len(kept)] = np.stack([columns[kept[:, 1]], rows[kept[:, 0]]], 1)
            weights[camera, : len(kept)] = 1.0
    return jnp.asarray(points, float), jnp.asarray(weights, float)
