"""A frame's features side by side, for a person to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.vision.features import FrameFeatures, scale_image
from poseppl.motion.vision.flow import Flow

COLUMNS = 4
TITLE_HEIGHT = 22
FULL_FLOW = 8.0
"""Flow of this many px has full colour."""


def features_picture(image: Image, features: FrameFeatures) -> Image:
    """Draw the frame, its foreground, edges, distances and flow as tiles with titles.

    Args:
        image: (H, W, 3) RGB or (H, W) gray, as recorded; it is scaled to the features.
        features: The features.

    Returns:
        (height, width, 3) RGB. Foreground is white, ignored pixels orange; distances run from dark to bright; flow shows its
        direction as hue and its length as brightness, outliers red.
    """
    cv2 = opencv()
    height, width = features.foreground.shape
    shown = cv2.resize(scale_image(image, 1.0), (width, height), interpolation=cv2.INTER_AREA)
    foreground = _gray(255 * features.foreground)
    foreground[features.ignore != 0] = (255, 150, 0)
    tiles: list[tuple[str, Image]] = [
        ("frame", shown),
        ("foreground", foreground),
        ("edges", _gray(255 * features.edges)),
        ("edge proximity", _gray(np.rint(255 * features.edge_proximity).astype(np.uint8))),
        ("edge distance", _coloured(features.edge_distance)),
        ("silhouette distance", _coloured(features.silhouette_distance)),
    ]
    if features.flow.size:
        outliers = _gray(np.zeros((height, width), np.uint8))
        outliers[features.flow_outliers != 0] = (230, 40, 40)
        tiles += [("flow", _flow(features.flow)), ("flow outliers", outliers)]
    titled = [_titled(title, tile) for title, tile in tiles]
    titled += [np.full_like(titled[0], 255)] * (-len(titled) % COLUMNS)
    rows = [np.concatenate(titled[i : i + COLUMNS], axis=1) for i in range(0, len(titled), COLUMNS)]
    return np.concatenate(rows, axis=0)


def _gray(plane: NDArray[np.uint8]) -> Image:
    return np.repeat(plane[..., None], 3, axis=-1)


def _coloured(plane: NDArray[np.float32]) -> Image:
    cv2 = opencv()
    low, high = float(plane.min()), float(plane.max())
    level = np.rint((plane - low) * (255.0 / max(high - low, 1e-6))).astype(np.uint8)
    coloured: Image = cv2.cvtColor(cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
    return coloured


def _flow(flow: Flow) -> Image:
    cv2 = opencv()
    length, angle = cv2.cartToPolar(flow[..., 0], flow[..., 1], angleInDegrees=True)
    hue = np.rint(angle / 2).astype(np.int64) % 180
    value = np.rint(255 * np.minimum(length / FULL_FLOW, 1.0))
    hsv = np.stack([hue, np.full_like(hue, 255), value], axis=-1).astype(np.uint8)
    rgb: Image = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)
    return rgb


def _titled(title: str, tile: Image) -> Image:
    bar = np.full((TITLE_HEIGHT, tile.shape[1], 3), 255, np.uint8)
    opencv().putText(bar, title, (6, 16), 0, 0.5, (34, 38, 43), 1, 16)
    return np.concatenate([bar, tile], axis=0)
