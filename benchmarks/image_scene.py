"""Rendered scenes with truth for image-based trackers: rendered once, seen through the features of their videos."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.feature_evidence import two_way_of_features
from poseppl_models.image_program import ImageInputs

from poseppl.cli.simulate import simulate
from poseppl.diagnostics import VIRTUAL_MARKERS, virtual_markers
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.geometry import Cameras
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.video_sources import DEFAULT_MODEL, sources_of_scene
from poseppl.motion.vision import FeatureSettings, FrameFeatures, video_features
from poseppl.runs.run import Constant, frame_inputs

STRIDE = 4
"""Pixels between points of the likelihoods' grids."""


class Seen(NamedTuple):
    """A scene of T frames in C cameras.

    Attributes:
        name: Of the scene.
        rate: Frames a second.
        cameras: C cameras.
        two_way: Evidence of silhouettes and edges, leaves (T, C, ...).
        usable: Whether a camera says anything (T, C).
        features: Those of the first camera, T of them.
        images: Its images (T, H, W, 3).
        truth: The fifteen virtual markers (T, 15, 3), mm.
        places: The same by name (all frames of the scene, 3).
    """

    name: str
    rate: float
    cameras: Cameras
    two_way: Any
    usable: np.ndarray
    features: list[FrameFeatures]
    images: list[np.ndarray]
    truth: np.ndarray
    places: dict[str, np.ndarray]


def rendered(folder: Path, name: str, arguments: Sequence[str]) -> Path:
    """The folder of a scene, rendered with arguments of ``poseppl simulate`` unless it is there."""
    place = folder / name
    if not place.exists():
        folder.mkdir(parents=True, exist_ok=True)
        simulate.main([*arguments, "--video", "--output", str(place)], standalone_mode=False)
    return place


def see(place: Path, frames: int) -> Seen:
    """Take the features of the first frames of a scene, from the picture of its empty room."""
    sources, settings = sources_of_scene(place), FeatureSettings(flow=None)
    views = []
    for video in sources.videos:
        plate = next(iter(sources.plates[video.camera].images()))
        occlusion = sources.occlusion[video.camera]
        views.append(video_features(video, settings, plate=plate, ignore=occlusion, stop=frames, bad_mask="ignore"))
    rows, usable, first = [], [], []
    for features in zip(*views, strict=True):
        rows.append(jax.tree.map(np.asarray, two_way_of_features(features, stride=STRIDE)))
        usable.append([not each.ignore.all() for each in features])
        first.append(features[0])
    names = load_builder(DEFAULT_MODEL)(None).tree.marker_names
    markers = virtual_markers(names, sources.truth.markers)
    images = [image for image, _ in zip(sources.videos[0].images(), range(len(rows)), strict=False)]
    return Seen(
        place.name,
        sources.videos[0].rate,
        cameras_of_records(sources.records),
        jax.tree.map(lambda *leaves: np.stack(leaves), *rows),
        np.array(usable),
        first,
        images,
        markers[: len(rows)],
        dict(zip(VIRTUAL_MARKERS, np.moveaxis(markers, 1, 0), strict=True)),
    )


def frames_of(
    seen: Seen, views: Sequence[int], evidence: Any, start: Any, start_scale: Any, step_scale: Any
) -> list[ImageInputs]:
    """Inputs of each frame for some of the cameras; evidence has leaves (T, len(views), ...)."""
    fixed: Any = Constant
    chosen = jax.tree.map(lambda leaf: leaf[jnp.asarray(views)], seen.cameras)
    states = (fixed(jnp.asarray(value, float)) for value in (start, start_scale, step_scale))
    inputs = ImageInputs(fixed(chosen), np.asarray(seen.usable[:, list(views)], np.float32), evidence, *states)
    return [frame_inputs(inputs, frame) for frame in range(len(seen.truth))]
