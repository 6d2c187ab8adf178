"""Seconds a frame for the image features of four cameras of 640 x 480, and what each feature costs.

    python -m benchmarks.features [--quick] [--data FOLDER]

The pictures are those of PARSEC's bodytrack where FOLDER (or $POSEPPL_DATA) holds them, with the person painted out for a
background, or else drawn. The frame before is the same picture shifted by 2 px. The rival in the same run is OpenCV's own
background subtraction of the four pictures, which nothing that starts from video can do without. Goal: 0.15 s on 2 cores.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.timing import interleave, show
from poseppl.motion.io import read_image
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.vision import (
    Background,
    FeatureSettings,
    background_from_plate,
    clean_mask,
    colour_bins,
    colour_histogram,
    edge_distance,
    edge_proximity,
    extract,
    find_edges,
    foreground_flow,
    fourier_descriptors,
    outer_contour,
    refine_mask,
    silhouette_distance,
)


class View(NamedTuple):
    """One camera: the frame, the one before, the background, and the foreground found."""

    image: Image
    previous: Image
    background: Background
    foreground: Image


def recorded(folder: Path, number: int) -> View:
    """A camera of bodytrack."""
    cv2 = opencv()
    image = read_image(folder / f"CAM{number}" / "image0000.bmp")
    mask = (read_image(folder / f"FG{number}" / "image0000.bmp")[..., 0] > 0).astype(np.uint8)
    plate = cv2.inpaint(image, cv2.dilate(mask, np.ones((15, 15), np.uint8)), 5, cv2.INPAINT_TELEA)
    return view(image, plate)


def drawn(number: int) -> View:
    """A textured room with a textured person."""
    cv2, rng = opencv(), np.random.default_rng(number)
    plate, cloth = (cv2.GaussianBlur(rng.integers(0, 255, (480, 640, 3), dtype=np.uint8), (0, 0), 3) for _ in range(2))
    mask = cv2.ellipse(np.zeros((480, 640), np.uint8), (320, 250), (60, 170), 10, 0, 360, 1, -1)
    return view(np.where(mask[..., None] == 1, np.minimum(cloth, 195) + 60, plate), plate)


def view(image: Image, plate: Image) -> View:
    background = background_from_plate(plate)
    return View(image, np.roll(image, 2, axis=1), background, background.subtract(image).foreground)


def parts(views: list[View], settings: FeatureSettings) -> dict[str, Callable[[], Any]]:
    """Each feature of all cameras, one camera after the other."""
    edges = [find_edges(v.image, settings.edges, v.foreground) for v in views]
    truncation, flow = settings.truncation, settings.flow

    def histogram(v: View) -> Any:
        return colour_histogram(colour_bins(v.image[v.foreground != 0][None]))

    return {
        "mixture alone (OpenCV)": lambda: [v.background.mixture.apply(v.image, None, 0.0) for v in views],
        "cleaning of the mask": lambda: [clean_mask(v.foreground) for v in views],
        "completion by colour": lambda: [
            refine_mask(v.image, v.background.mixture.getBackgroundImage(), v.foreground, 6.0) for v in views
        ],
        "edges": lambda: [find_edges(v.image, settings.edges, v.foreground) for v in views],
        "edge proximity": lambda: [edge_proximity(e, settings.edges.sigma) for e in edges],
        "edge distance": lambda: [edge_distance(e, truncation) for e in edges],
        "silhouette distance": lambda: [silhouette_distance(v.foreground, truncation) for v in views],
        "colour histogram": lambda: [histogram(v) for v in views],
        "contour and descriptors": lambda: [fourier_descriptors(outer_contour(v.foreground)) for v in views],
        "flow and outliers": lambda: [foreground_flow(v.previous, v.image, v.foreground, flow) for v in views],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tiny size, to see that it runs")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("POSEPPL_DATA", "data")), help="the recordings")
    options = parser.parse_args()
    folder = options.data / "parsec_bodytrack" / "sequenceB_1"
    views = [recorded(folder, number) if folder.is_dir() else drawn(number) for number in (1, 2, 3, 4)]
    settings = FeatureSettings()

    def take(v: View, chosen: FeatureSettings = settings) -> Any:
        return extract(v.image, v.background, chosen, previous=v.previous)

    with ThreadPoolExecutor(2) as pool:
        rivals = parts(views, settings) | {
            "all, a camera after the other": lambda: [take(v) for v in views],
            "all, two cameras at a time": lambda: list(pool.map(take, views)),
            "all but flow, two at a time": lambda: list(pool.map(lambda v: take(v, settings._replace(flow=None)), views)),
        }
        seconds = interleave(rivals, 2 if options.quick else 25)
    base = seconds["mixture alone (OpenCV)"].median
    share = np.mean([v.foreground.mean() for v in views])
    start = time.process_time()
    for _ in range(10):
        rivals["all, a camera after the other"]()
    busy = (time.process_time() - start) / 10
    show(
        f"Features of 4 cameras, 640 x 480, {'recorded' if folder.is_dir() else 'drawn'}, {share:.0%} foreground",
        ["", "ms a frame", "of the mixture alone"],
        [[name, f"{1e3 * timing.median:.1f}", f"{timing.median / base:.2f}"] for name, timing in seconds.items()],
    )
    print(
        f"All features take {1e3 * busy:.0f} ms of processor time a frame: {500 * busy:.0f} ms on two cores with no other work."
    )


if __name__ == "__main__":
    main()
