"""Overlay videos: sampled skeletons of the posterior, and their mean, over the pictures they were tracked in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array, some_draws
from poseppl.errors import FilePath, InputError, brief
from poseppl.motion.io import Video, write_video
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.io.text_parsing import some
from poseppl.motion.measures import edges, mean_points
from poseppl.runs.contents import frame_numbers, names_of

MAX_SAMPLES = 12
_SHIFT = 4
"""OpenCV's fractional bits: lines are drawn to a sixteenth of a pixel."""
_SAMPLE, _MEAN = (255, 170, 60), (30, 220, 255)
_DEFAULT_RATE = 25.0


def overlay_frames(tree: xr.DataTree, video: Video) -> Iterator[Image]:
    """Draw the posterior over the frames of a camera's video.

    Args:
        tree: The result, which holds the extra ``points``.
        video: The video, named as a camera of the result.

    Yields:
        (H, W, 3) RGB images, one for each frame of the result, of even height and width.

    Raises:
        InputError: The result does not know the camera, or holds no points.
    """
    names = names_of(tree, "camera")
    samples, means = some_draws(tree, "points", MAX_SAMPLES), mean_points(tree)
    if samples is None or means is None or video.camera not in names:
        raise InputError(f"no points of the camera {brief(video.camera)}", expected=f"one of {some(names) or 'none'}")
    camera, pairs = names.index(video.camera), edges(tree)
    frames = frame_numbers(tree)
    wanted = {int(number): index for index, number in enumerate(frames)}
    first = int(frames[0])
    for number, image in enumerate(video.images(first, int(frames[-1]) + 1), start=first):
        if number in wanted:
            index = wanted[number]
            yield _even(draw_skeletons(image, samples[:, index, camera], means[index, camera], pairs))


def write_overlay(path: FilePath, tree: xr.DataTree, video: Video, advance: Callable[[int], None] = lambda frames: None) -> int:
    """Write the overlay of a camera as a video, whole or not at all, and report each frame. Returns the number of frames."""

    def frames() -> Iterator[Image]:
        for image in overlay_frames(tree, video):
            yield image
            advance(1)

    return write_video(path, frames(), video.rate or _DEFAULT_RATE)


def draw_skeletons(image: Image, samples: Array, mean: Array, pairs: Any) -> Image:
    """Draw sampled skeletons thinly and their mean on top.

    Args:
        image: (H, W, 3) RGB; it is copied.
        samples: (S, K, 2) px.
        mean: (K, 2) px.
        pairs: Pairs of markers that are joined.
    """
    cv2 = opencv()
    drawn = image.copy()
    width = max(1, round(max(image.shape) / 500))
    for points, colour, thickness in [*((each, _SAMPLE, width) for each in samples), (mean, _MEAN, 2 * width)]:
        lines = [_fixed(points[[first, last]]) for first, last in pairs]
        cv2.polylines(drawn, [line for line in lines if line is not None], False, colour, thickness, cv2.LINE_AA, _SHIFT)
    return np.asarray(drawn, np.uint8)


def _fixed(points: Array) -> Any:
    """Points in OpenCV's fixed numbers, or None where they are far outside."""
    if not np.all(np.abs(points) < 1e5):
        return None
    return np.round(points * 2**_SHIFT).astype(np.int32)


def _even(image: Image) -> Image:
    return np.ascontiguousarray(image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2])
