"""A scene of silhouettes: what several cameras' videos, or masks, say of one person's outline over time."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Cameras
from poseppl.motion.io import CameraRecord, Video
from poseppl.motion.io.synchronised import VideoWarning, synchronised
from poseppl.motion.io.text_parsing import some
from poseppl.motion.silhouettes.data import SilhouetteData
from poseppl.motion.silhouettes.frame import (
    Mask,
    OnFailure,
    SilhouetteFrame,
    SilhouetteSettings,
    edge_map,
    fit_size,
    map_scale,
    resized,
    silhouette_frame,
)
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.vision import (
    Background,
    Foreground,
)


def silhouette_scene(
    body: Body,
    records: Sequence[CameraRecord],
    masks: Mapping[str, NDArray[Any]],
    *,
    occlusion: Mapping[str, Mask] | None = None,
    settings: SilhouetteSettings | None = None,
    rate: float | None = None,
    source: str = "masks",
) -> Scene[SilhouetteData]:
    """Make a scene of foreground masks.

    Args:
        body: The body, whose program sees silhouettes.
        records: C calibrated cameras.
        masks: Masks (T, H, W) by the camera's name, not 0 on the person.
        occlusion: Masks (H, W) by the camera's name, not 0 where furniture is that may hide the person. Cameras may be left
            out. To ignore pixels of `masks`, set them to 0 there and mark them here.
        settings: The settings.
        rate: Frames a second.
        source: Source of the masks, for the record.

    Returns:
        The scene. A mask that is empty or full counts as not seen, and is reported as a ``VideoWarning``.

    Raises:
        InputError: A camera has no masks, or they are of another length or size than they should be.
    """
    chosen = (settings or SilhouetteSettings()).check()
    check_names(records, list(masks))
    lengths = {name: len(values) for name, values in masks.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"cameras differ in their number of masks: {lengths}", field="masks", expected="one length for all")
    records = [fit_size(record, np.shape(masks[record.name])[:0:-1]) for record in records]
    frames = [
        [
            silhouette_frame(np.asarray(masks[record.name][number]), (occlusion or {}).get(record.name), record, number, chosen)
            for record in records
        ]
        for number in range(min(lengths.values()))
    ]
    return _assemble(body, records, frames, chosen, rate, source)


def scene_of_videos(
    body: Body,
    records: Sequence[CameraRecord],
    videos: Sequence[Video],
    backgrounds: Mapping[str, Background],
    *,
    masks: Mapping[str, Video] | None = None,
    occlusion: Mapping[str, Mask] | None = None,
    settings: SilhouetteSettings | None = None,
    start: int = 0,
    stop: int | None = None,
    on_failure: OnFailure = "continue",
    advance: Any = None,
) -> Scene[SilhouetteData]:
    """Make a scene of videos whose backgrounds are known or were learned, or whose masks are given.

    Args:
        body: The body, whose program sees silhouettes.
        records: C calibrated cameras.
        videos: Their videos, by name.
        backgrounds: By name, of the cameras without masks.
        masks: For some cameras, by their names, masks as videos, white on the person; of any size in the camera's proportion.
        occlusion: As :func:`silhouette_scene` takes it; pixels without evidence from the background are added to it.
        settings: The settings.
        start: The first frame.
        stop: The frame after the last; None for all.
        on_failure: "continue" without cameras that see nobody, and up to where the first video ends or cannot be decoded, each
            reported as a ``VideoWarning``; or "stop" there.
        advance: Called with 1 after each frame.

    Raises:
        InputError: Names do not match, the first frame cannot be decoded, or what `on_failure` stops at.
    """
    chosen = (settings or SilhouetteSettings()).check()
    check_names(records, [video.camera for video in videos])
    sizes = {video.camera: video.size for video in videos}
    records = [fit_size(record, sizes[record.name]) for record in records]
    given = masks or {}
    frames = []
    for number, images in _readable([*videos, *given.values()], start, stop, on_failure):
        row = []
        for record in records:
            blind = (occlusion or {}).get(record.name)
            found = _foreground(images, record, backgrounds, given.get(record.name), blind)
            hiding = found.ignore if blind is None else found.ignore + 2.0 * blind  # each keeps its edges
            seen = silhouette_frame(found.foreground, hiding, record, number, chosen, on_failure)
            edges = edge_map(images[record.name], found.foreground, map_scale(record, chosen)) if chosen.edges else None
            row.append(seen._replace(edges=edges))
        frames.append(row)
        if advance is not None:
            advance(1)
    if not frames:
        raise InputError("the videos have no frame", field=Argument("videos"), expected="at least one")
    return _assemble(body, records, frames, chosen, videos[0].rate, _together([video.source for video in videos]), start)


def _foreground(
    images: Mapping[str, NDArray[np.uint8]],
    record: CameraRecord,
    backgrounds: Mapping[str, Background],
    masks: Video | None,
    occlusion: Mask | None,
) -> Foreground:
    """Foreground of a camera's mask; without masks, what differs from the background."""
    if masks is None:
        return backgrounds[record.name].subtract(images[record.name], occlusion=occlusion)
    mask = resized(images[masks.camera][..., 0], record.size, "mask", record.name) > 127
    return Foreground(mask.astype(np.uint8), np.zeros(mask.shape, np.uint8))


def _readable(
    videos: Sequence[Video], start: int, stop: int | None, on_failure: OnFailure
) -> Iterator[tuple[int, dict[str, NDArray[np.uint8]]]]:
    """Frames of all videos, up to the first that cannot be decoded."""
    number = start - 1
    try:
        for number, images in synchronised(
            videos, start=start, stop=stop, mismatch="raise" if on_failure == "stop" else "shortest"
        ):
            yield number, images
    except InputError as error:
        if on_failure == "stop" or number < start:
            raise
        warnings.warn(f"{error}; the run ends before this frame", VideoWarning, stacklevel=3)


def _together(sources: Sequence[str]) -> str:
    """One source, or the folder that several are in."""
    if len(set(sources)) == 1:
        return sources[0]
    return f"{len(sources)} videos of {os.path.commonpath([os.path.abspath(source) for source in sources])}"


def check_names(records: Sequence[CameraRecord], names: Sequence[str]) -> None:
    """Check that the calibration and the pictures speak of the same cameras.

    Raises:
        InputError: They do not.
    """
    known = [record.name for record in records]
    lacking, strange = [name for name in known if name not in names], [name for name in names if name not in known]
    if lacking or strange:
        problem = f"the calibration knows the cameras {some(known)}; there are pictures of {some(names) or 'none'}"
        raise InputError(problem, field=Argument("calibration"), expected="the same names; give videos as NAME=FILE")


def _assemble(
    body: Body,
    records: Sequence[CameraRecord],
    frames: Sequence[Sequence[SilhouetteFrame]],
    settings: SilhouetteSettings,
    rate: float | None,
    source: str,
    start: int = 0,
) -> Scene[SilhouetteData]:
    cameras: Cameras = cameras_of_records(records)
    names = tuple(record.name for record in records)
    data = SilhouetteData(
        np.array([[frame.contour for frame in row] for row in frames]),
        np.array([[frame.on_outline != 0 for frame in row] for row in frames]),
        _same_size([[frame.distance for frame in row] for row in frames]),
        np.array([map_scale(record, settings) for record in records]),
        np.array([[frame.usable for frame in row] for row in frames]),
        _same_size([[frame.person for frame in row] for row in frames], -1).astype(np.int8),
        settings.noise,
        _same_size([[frame.edges for frame in row] for row in frames]) if frames[0][0].edges is not None else None,
        found=settings._asdict(),
    )
    return Scene(body, cameras, names, data, start + np.arange(len(frames)), rate, source)


def _same_size(maps: Sequence[Sequence[Any]], beyond: float | None = None) -> NDArray[np.float32]:
    """Stack maps (H, W) of each frame and camera; smaller ones are continued by a value, or by their border."""
    height, width = (max(each.shape[axis] for each in maps[0]) for axis in (0, 1))
    how: dict[str, Any] = {"mode": "edge"} if beyond is None else {"constant_values": beyond}
    grown = [[np.pad(each, ((0, height - each.shape[0]), (0, width - each.shape[1])), **how) for each in row] for row in maps]
    return np.array(grown, np.float32)
