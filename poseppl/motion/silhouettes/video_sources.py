"""Sources of tracking from video: cameras, their pictures, their backgrounds, and the truth where it is known."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from poseppl_models.bodies.silhouettes import full_body

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Location, brief
from poseppl.files.frame_range import FrameRange
from poseppl.files.netcdf import read_netcdf
from poseppl.motion.bodies.body import body_builder, name_of_builder
from poseppl.motion.io import CameraRecord, Video, open_masks, open_video, read_calibration, read_cameras, read_image
from poseppl.motion.io.text_parsing import finite_numbers, some
from poseppl.motion.silhouettes.data import SilhouetteData, check_facing
from poseppl.motion.silhouettes.frame import OnFailure, SilhouetteSettings, resized
from poseppl.motion.silhouettes.scene import check_names, scene_of_videos
from poseppl.motion.silhouettes.settings import VideoSettings
from poseppl.motion.tracking.body_sizes import subject_lengths
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.vision import Background, BackgroundSettings, learn_background

DEFAULT_MODEL = name_of_builder(full_body)
"""The body that is tracked where nobody names one."""
_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".webm")

Image = NDArray[np.uint8]


class SceneTruth(NamedTuple):
    """The truth of a rendered scene: ``states`` (T, d), ``markers`` (T, K, 3) mm, and the subject's segment lengths, mm."""

    states: Floats
    markers: Floats
    lengths: Mapping[str, float]


class VideoSources(NamedTuple):
    """Pictures and what is known of them, by the cameras' names.

    Attributes:
        records: Calibrated cameras.
        videos: Their videos.
        plates: For some cameras, the background plate: pictures of the scene without a person, from which the background is
            learned; for the others it is learned from the video itself.
        occlusion: For some cameras, a mask (H, W) that is not 0 where furniture is that may hide the person.
        masks: For some cameras, masks of the person as videos, in place of a background.
        truth: The truth, where it is known.
    """

    records: tuple[CameraRecord, ...]
    videos: tuple[Video, ...]
    plates: Mapping[str, Video]
    occlusion: Mapping[str, Image]
    masks: Mapping[str, Video]
    truth: SceneTruth | None = None


def open_named(videos: Sequence[FilePath]) -> list[Video]:
    """Open videos, each ``FILE``, whose name without suffix is the camera's, or ``NAME=FILE``; a folder of images is a video.

    Raises:
        InputError: A file cannot be read, or two are of one camera.
    """
    named = [_named(word) for word in videos]
    names = [name for name, _ in named]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"two videos of the camera {twice[0]!r}", expected="one of each; or NAME=FILE")
    return [open_video(path, name) for name, path in named]


def sources_of_files(
    videos: Sequence[FilePath],
    calibration: FilePath,
    *,
    plates: Sequence[FilePath] = (),
    occlusion: Sequence[FilePath] = (),
    masks: Sequence[FilePath] = (),
    up: str | None = None,
) -> VideoSources:
    """Open videos and what goes with them.

    Args:
        videos: Each ``FILE``, whose name without suffix is the camera's, or ``NAME=FILE``; a folder of images is a video.
        calibration: Cameras as TOML; those without a video are left out.
        plates: Pictures or clips of the empty scene, named alike.
        occlusion: Pictures that are white where furniture is that may hide the person, black elsewhere, named alike.
        masks: Masks of the person, white on them, as :func:`~poseppl.motion.io.open_masks` opens them, named alike.
        up: The axis of the calibration that points up; Z if None.

    Raises:
        InputError: A file cannot be read, or a name is not that of a calibrated camera.
    """
    records = read_calibration(calibration, up=up).cameras
    opened = open_named(videos)
    names = [video.camera for video in opened]
    known = [record.name for record in records]
    strange = [name for name in names if name not in known]
    if strange:
        problem = f"the video of {strange[0]!r} has no calibration"
        raise InputError(problem, file=str(calibration), field=Argument("videos"), expected=f"{some(known)}; or NAME=FILE")
    kept = tuple(record for record in records if record.name in names)
    order = {record.name: number for number, record in enumerate(kept)}
    backgrounds = {name: open_video(path, name) for name, path in map(_named, plates)}
    occlusions = {name: read_image(path, name)[..., 0] for name, path in map(_named, occlusion)}
    given = {name: open_masks(path, f"{name} (masks)") for name, path in map(_named, masks)}
    for argument, named in (("background", backgrounds), ("occlusion", occlusions), ("masks", given)):
        for name in named:
            if name not in order:
                expected = f"{some(order)}; or NAME=FILE"
                raise InputError(f"no video of the camera {name!r}", field=Argument(argument), expected=expected)
    return VideoSources(kept, tuple(sorted(opened, key=lambda video: order[video.camera])), backgrounds, occlusions, given)


def sources_of_scene(folder: FilePath, cameras: Sequence[str] = ()) -> VideoSources:
    """Open a rendered scene, a folder of videos that ``poseppl simulate`` has made.

    Args:
        folder: The folder.
        cameras: Names of the cameras to use; all if empty.

    Raises:
        InputError: The folder is none, or a file of it cannot be read.
    """
    place = Path(folder)
    if not (place / "Calib.toml").is_file():
        raise InputError("no scene", file=folder, expected="a folder of videos of poseppl simulate, with Calib.toml")
    records = tuple(record for record in read_cameras(place / "Calib.toml") if not cameras or record.name in cameras)
    check_names(records, list(cameras) or [record.name for record in records])
    for record in records:
        if Path(record.name).name != record.name:
            expected = "the name of a file in the scene's folder"
            raise InputError(f"a camera called {brief(record.name)}", file=place / "Calib.toml", expected=expected)
    videos = tuple(open_video(place / f"{record.name}.mp4", record.name) for record in records)
    plates = {record.name: open_video(place / f"{record.name}_background.png", record.name) for record in records}
    occlusion = {record.name: read_image(place / f"{record.name}_occluder.png", record.name)[..., 0] for record in records}
    truth = read_scene_truth(place / "truth.nc") if (place / "truth.nc").is_file() else None
    return VideoSources(records, videos, plates, occlusion, {}, truth)


def read_scene_truth(path: FilePath) -> SceneTruth:
    """Read the truth that ``poseppl simulate`` wrote as NetCDF.

    Raises:
        InputError: The file holds none.
    """
    tree = read_netcdf(path, expected="a file of poseppl simulate")
    try:
        known = tree["truth"].dataset
        states, markers = (np.asarray(known[name].values, np.float64) for name in ("state", "markers"))
        return SceneTruth(states, markers, json.loads(tree.attrs["lengths"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"no truth: {error}", file=path, expected="a file of poseppl simulate") from error


def is_video(path: FilePath) -> bool:
    """Whether a path looks like a video, and not like a rendered scene."""
    return Path(path).suffix.lower() in _SUFFIXES or not (Path(path) / "scene.toml").is_file()


def see_silhouettes(
    sources: VideoSources,
    *,
    model: str = DEFAULT_MODEL,
    stature: float | None = None,
    lengths: FilePath | None = None,
    settings: SilhouetteSettings | None = None,
    background: BackgroundSettings | None = None,
    facing: str | None = None,
    start: int = 0,
    stop: int | None = None,
    on_failure: OnFailure = "continue",
    advance: Callable[[int], None] | None = None,
) -> Scene[SilhouetteData]:
    """Learn the backgrounds and find the silhouettes.

    Args:
        sources: Sources of the pictures.
        model: Builder of the body.
        stature: Stature of the person, mm, which scales the standard subject's segment lengths. None takes the lengths of the
            truth, where it is known, or of the standard subject.
        lengths: A TOML file of segment lengths, mm, that are known.
        settings: Settings of the silhouettes.
        background: How the foreground is found.
        facing: Name of the camera that the person faces at first, if known.
        start: The first frame.
        stop: The frame after the last; None for all.
        on_failure: As :func:`~poseppl.motion.silhouettes.scene.scene_of_videos` takes it.
        advance: Called with 1 after each frame.

    Raises:
        InputError: As :func:`~poseppl.motion.silhouettes.scene.scene_of_videos`, the stature is not a person's, or
        there is no
            camera of the name that the person faces.
    """
    truth = sources.truth
    if facing is not None:
        check_facing(facing, [record.name for record in sources.records])
    body = body_builder(model)(subject_lengths(model, stature, lengths, _known_lengths(model, truth)))
    backgrounds = {
        video.camera: _background(video, sources.plates.get(video.camera), background)
        for video in sources.videos
        if video.camera not in sources.masks
    }
    sizes = {video.camera: video.size for video in sources.videos}
    occlusion = {name: resized(mask, sizes[name], "occlusion mask", name) for name, mask in sources.occlusion.items()}
    scene = scene_of_videos(
        body,
        sources.records,
        sources.videos,
        backgrounds,
        masks=sources.masks,
        occlusion=occlusion,
        settings=settings,
        start=start,
        stop=stop,
        on_failure=on_failure,
        advance=advance,
    )
    found = {**(scene.data.found or {}), **_found(sources, background, facing)}
    scene = scene._replace(data=scene.data._replace(facing=facing, found=found))
    if truth is None:
        return scene
    part = slice(start, start + len(scene.frames))
    return scene._replace(states=truth.states[part], markers=truth.markers[part])


def open_sources(settings: VideoSettings) -> VideoSources:
    """Open the videos that settings name, and what goes with them.

    Raises:
        InputError: As :func:`sources_of_files` and :func:`sources_of_scene`.
    """
    if settings.of_scene:
        return sources_of_scene(settings.videos[0])
    return sources_of_files(
        settings.videos,
        settings.calibration or "",
        plates=settings.background,
        occlusion=settings.occlusion,
        masks=settings.masks,
        up=settings.up,
    )


def read_video_scene(
    settings: VideoSettings,
    sources: VideoSources,
    *,
    on_failure: OnFailure = "continue",
    advance: Callable[[int], None] | None = None,
) -> Scene[SilhouetteData]:
    """The silhouettes that settings name, as :func:`see_silhouettes` finds them.

    Args:
        settings: Settings of the silhouettes.
        sources: The videos, opened.
        on_failure: As :func:`~poseppl.motion.silhouettes.scene.scene_of_videos` takes it.
        advance: Called with 1 after each frame.

    Raises:
        InputError: As :func:`see_silhouettes`.
    """
    frames, usual = FrameRange.parse(settings.frames), SilhouetteSettings()
    scene = see_silhouettes(
        sources,
        model=settings.model or DEFAULT_MODEL,
        stature=settings.stature,
        lengths=settings.lengths,
        settings=usual._replace(noise=settings.silhouette_noise or usual.noise, edges=settings.edges),
        background=BackgroundSettings(refine=settings.refine),
        facing=settings.facing,
        start=frames.start,
        stop=frames.stop,
        on_failure=on_failure,
        advance=advance,
    )
    return scene if settings.rate is None else scene._replace(rate=settings.rate)


def _found(sources: VideoSources, background: BackgroundSettings | None, facing: str | None) -> dict[str, Any]:
    """Record the source of the silhouettes: cameras with masks or pictures of the empty scene, and how the others are found."""
    given = {"masks": sorted(sources.masks), "plates": sorted(sources.plates), "occlusion": sorted(sources.occlusion)}
    settings = (background or BackgroundSettings())._asdict()
    return {**given, "facing": facing, "background": settings if len(sources.masks) < len(sources.records) else None}


def _known_lengths(model: str, truth: SceneTruth | None) -> Mapping[str, float] | None:
    return (
        None if truth is None else finite_numbers(truth.lengths, body_builder(model)(None).lengths, Location(field="lengths"))
    )


def _background(video: Video, plate: Video | None, settings: BackgroundSettings | None) -> Background:
    if plate is None:
        return learn_background(video.images(), settings)
    pictures = [resized(picture, video.size, "picture of the empty scene", video.camera) for picture in plate.images()]
    return learn_background(pictures, settings)


def _named(word: FilePath) -> tuple[str, str]:
    """``NAME=FILE``, or a file whose name without suffix is the camera's."""
    name, equals, path = str(word).partition("=")
    return (name, path) if equals else (Path(str(word)).stem, str(word))
