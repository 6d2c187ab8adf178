"""Features of one frame of one camera: foreground, edges, distances, colours, contour, flow; and their picture.

    background = learn_background(video.images(), settings.background)
    features = extract(image, background, settings, previous=before, camera="front", frame=12)

All maps have the size of the scaled image: a point (x, y) of the recording is at ((x + 0.5) s - 0.5, (y + 0.5) s - 0.5) in
them, s being the scale, centres of pixels at whole numbers.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.checks import check_at_least, check_fraction
from poseppl.errors import InputError
from poseppl.motion.io.opencv import Image, check_image, opencv, to_rgb
from poseppl.motion.vision.background import Background, BackgroundSettings
from poseppl.motion.vision.colour import ColourSettings, Histogram, colour_bins, colour_histogram
from poseppl.motion.vision.contours import fourier_descriptors, outer_contour
from poseppl.motion.vision.edges import EdgeSettings, Map, edge_distance, edge_proximity, find_edges, silhouette_distance
from poseppl.motion.vision.flow import Flow, FlowSettings, foreground_flow
from poseppl.motion.vision.masks import Mask, check_mask

BadMask = Literal["raise", "ignore"]


class FeatureSettings(NamedTuple):
    """Which features are taken from a frame, and how.

    Attributes:
        background: Foreground.
        edges: Edges.
        colour: Colour histogram.
        flow: Optical flow; None for none, which saves a third of the time.
        scale: Images are scaled by this factor first, at most 1.
        truncation: Distances are cut off at so many px of the scaled image.
        descriptors: Number of Fourier descriptors.
    """

    background: BackgroundSettings = BackgroundSettings()
    edges: EdgeSettings = EdgeSettings()
    colour: ColourSettings = ColourSettings()
    flow: FlowSettings | None = FlowSettings()
    scale: float = 1.0
    truncation: float = 50.0
    descriptors: int = 20

    def check(self) -> FeatureSettings:
        """Refuse settings that cannot be used.

        Returns:
            The settings.

        Raises:
            ValueError: A number is out of its range.
        """
        self.background.check()
        self.edges.check()
        self.colour.check()
        if self.flow is not None:
            self.flow.check()
        check_fraction("(0, 1]", scale=self.scale)
        check_at_least(1, truncation=self.truncation, descriptors=self.descriptors)
        return self


class FrameFeatures(NamedTuple):
    """The features of one frame of one camera, (H, W) of the scaled image.

    Attributes:
        foreground: (H, W) uint8, 1 at the person.
        ignore: (H, W) uint8, 1 where there is no evidence.
        edges: (H, W) uint8, 1 at an edge.
        edge_proximity: (H, W) float32 in [0, 1].
        edge_distance: (H, W) float32 px to the nearest edge, truncated.
        silhouette_distance: (H, W) float32 px to the silhouette's outline, negative inside, truncated.
        histogram: (bins,) colours of the foreground, shares.
        descriptors: (count,) Fourier descriptors of the outer contour; NaN without one.
        flow: (H, W, 2) float32 px from the frame before to this one, sought around the foreground and 0 beyond; (0, 0, 2) in
            the first frame and without flow.
        flow_outliers: (H, W) uint8, 1 where the flow cannot be believed or was not sought; (0, 0) where there is no flow.
    """

    foreground: Mask
    ignore: Mask
    edges: Mask
    edge_proximity: Map
    edge_distance: Map
    silhouette_distance: Map
    histogram: Histogram
    descriptors: Floats
    flow: Flow
    flow_outliers: Mask


def extract(
    image: Image,
    background: Background,
    settings: FeatureSettings | None = None,
    *,
    previous: Image | None = None,
    ignore: Mask | None = None,
    occlusion: Mask | None = None,
    camera: str = "camera",
    frame: int = 0,
    bad_mask: BadMask = "raise",
) -> FrameFeatures:
    """Take the features of a frame.

    Args:
        image: (H, W, 3) RGB or (H, W) gray, as recorded.
        background: The background of the images scaled by ``settings.scale``.
        settings: The settings; None for the default ones.
        previous: The frame before, as recorded; None for none, and then there is no flow.
        ignore: (H, W) as recorded, not 0 at pixels that give no evidence; None for none.
        occlusion: (H, W) as recorded, not 0 where furniture may stand before the person; None for nowhere. Such a pixel gives
            no evidence unless it is foreground: then the person is before the furniture.
        camera: The camera, for messages.
        frame: The frame number, for messages.
        bad_mask: Treatment of a foreground that is (nearly) empty or full: "raise", or "ignore", which takes the whole
            image as ignored, without foreground.

    Returns:
        The features.

    Raises:
        InputError: The image is malformed or of another size than the background; or the foreground is (nearly) empty or full.
        ValueError: A setting is out of its range.
    """
    chosen = (settings or FeatureSettings()).check()
    scaled = scale_image(image, chosen.scale, camera, frame)
    blind, hiding = (None if mask is None else scale_mask(mask, scaled) for mask in (ignore, occlusion))
    foreground, ignored = background.subtract(scaled, blind, hiding)
    if hiding is not None:
        ignored = ignored | ((hiding != 0) & (foreground == 0)).astype(np.uint8)
    try:
        check_mask(foreground, camera, frame)
    except InputError:
        if bad_mask == "raise":
            raise
        foreground, ignored = np.zeros_like(foreground), np.ones_like(foreground)
    edges = find_edges(scaled, chosen.edges, foreground)
    edges[ignored != 0] = 0
    flow, outliers = np.zeros((0, 0, 2), np.float32), np.zeros((0, 0), np.uint8)
    if previous is not None and chosen.flow is not None:
        before = scale_image(previous, chosen.scale, camera, frame - 1)
        flow, outliers = foreground_flow(before, scaled, foreground, chosen.flow)
    return FrameFeatures(
        foreground=foreground,
        ignore=ignored,
        edges=edges,
        edge_proximity=edge_proximity(edges, chosen.edges.sigma),
        edge_distance=edge_distance(edges, chosen.truncation),
        silhouette_distance=silhouette_distance(foreground, chosen.truncation),
        histogram=colour_histogram(colour_bins(scaled[foreground != 0][None], chosen.colour), chosen.colour),
        descriptors=fourier_descriptors(outer_contour(foreground), chosen.descriptors),
        flow=flow,
        flow_outliers=outliers,
    )


def scale_image(image: Image, scale: float, camera: str | None = None, frame: int | None = None) -> Image:
    """Scale an image down, each new pixel the mean of those that it covers.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.
        scale: The factor, at most 1.
        camera: The camera, for messages.
        frame: The frame number, for messages.

    Returns:
        (round(scale H), round(scale W), 3) RGB.
    """
    cv2 = opencv()
    checked = check_image(image, camera, frame)
    rgb = checked if checked.ndim == 3 else to_rgb(checked)
    if scale == 1.0:
        return rgb
    size = (max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale)))
    scaled: Image = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    return scaled


def scale_mask(mask: Mask, image: Image) -> Mask:
    """Scale a mask to the size of an image: a pixel is marked where any pixel that it covers is.

    Args:
        mask: (h, w), not 0 where marked.
        image: (H, W, 3).

    Returns:
        (H, W) uint8, 0 or 1.
    """
    cv2 = opencv()
    marked = (np.asarray(mask) != 0).astype(np.float32)
    if marked.shape != image.shape[:2]:
        marked = cv2.resize(marked, image.shape[1::-1], interpolation=cv2.INTER_AREA)
    scaled: Mask = (marked > 0).astype(np.uint8)
    return scaled


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
