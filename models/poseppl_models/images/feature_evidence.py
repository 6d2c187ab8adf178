"""Evidence of the published likelihoods from the features of a video's frame (:func:`poseppl.motion.vision.extract`).

Errors of edges are (1 - proximity)^2, as in Eq. 8 of Darby, Li and Costen (2008) and in the cost of Deutscher and Reid (2005)
that Peursum, Venkatesh and West (2010, section 3.4) build on; those of silhouettes are 0 and 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.geometry import Cameras
from poseppl.motion.vision import ColourSettings, FrameFeatures, colour_bins
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.du_guan.evidence import DuGuanEvidence, du_guan_evidence, pad_bins, part_colours
from poseppl_models.images.two_way_evidence import TwoWayEvidence, two_way_evidence

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
