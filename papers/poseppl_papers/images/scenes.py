"""Scenes: a recording, rendered in a room with a camera in every corner, and what the cameras show of it.

A scene is rendered once on each machine, into the user's cache folder, under a hash of all that it is made of.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from poseppl_models.images.image_systems import SeenPerson, Sight

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.files.cache_folder import cache_folder
from poseppl.files.store import key_of
from poseppl.jobs import Job
from poseppl.jobs.job import later_field, plain_fields
from poseppl.motion.bodies.body import body_builder, load_builder
from poseppl.motion.bodies.subject import MovingSubject, fit_subject
from poseppl.motion.geometry import Cameras
from poseppl.motion.io import read_motion, resample, slice_frames
from poseppl.motion.recordings.subjects import turned, walking_subject
from poseppl.motion.recordings.truth import film_subject
from poseppl.motion.rendering import build_setting, find_toes
from poseppl.motion.silhouettes.video_sources import DEFAULT_MODEL, VideoSources, sources_of_scene
from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, virtual_markers
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.vision import FeatureSettings, video_features
from poseppl_papers.recordings import Recording

VERSION = 1
"""Counted up when the same scene comes to mean other pictures."""
_SETTINGS = FeatureSettings(flow=None)


@dataclass(frozen=True)
class Scene:
    """A recording in a room.

    Attributes:
        recording: Recording of the person that moves.
        clutter: Whether a table and chairs stand in the way.
        num_frames: How many frames, from the first on.
        rate: Frames a second, at most those of the recording: its frames where every n-th has this rate, points between two
            of them elsewhere.
        width: Width of the images, px.
        height: Height of the images, px.
        radius: Radius of a circle on the floor that the walk follows, mm; positive turns left. As recorded if None.
        announced: Whether trackers are given the pixels where furniture is seen in the empty room. Unless the person is seen
            there, before the furniture, they count neither for nor against a pose. The pictures are the same.
    """

    recording: Recording
    clutter: bool
    num_frames: int = 40
    rate: float = 30.0
    width: int = 640
    height: int = 480
    radius: float | None = later_field(None)
    announced: bool = later_field(True)

    @property
    def name(self) -> str:
        """Name in tables."""
        circle = "" if self.radius is None else f"-circle{self.radius:g}"
        silent = "" if self.announced else "-unannounced"
        return f"{self.recording.name}-{'clutter' if self.clutter else 'clean'}{circle}{silent}"

    @property
    def folder(self) -> Path:
        """Folder of its rendered pictures."""
        fields = {**plain_fields(replace(self, announced=True)), "recording": self.recording.digest, "version": VERSION}
        return cache_folder("scenes") / key_of(fields)[:24]


@dataclass(frozen=True)
class Rendering(Job):
    """The job of rendering a scene before trackers want it, each of which would do it."""

    scene: Scene

    @property
    def name(self) -> str:
        """That of the scene."""
        return f"scene-{self.scene.name}"


def render(job: Rendering) -> dict[str, Any]:
    """Render a scene unless it is there.

    Returns:
        ``truth`` (T, 15, 3), mm.
    """
    return {"truth": see(job.scene).truth}


class SeenScene(NamedTuple):
    """A scene of T frames in C cameras.

    Attributes:
        rate: Frames a second.
        cameras: C cameras, px.
        truth: The fifteen virtual markers (T, 15, 3), mm.
        sources: Its videos.
        announced: Whether pixels of furniture are left out where nobody is seen before it.
    """

    rate: float
    cameras: Cameras
    truth: Floats
    sources: VideoSources
    announced: bool = True

    def person(self) -> SeenPerson:
        """Person that is seen."""
        markers = dict(zip(VIRTUAL_MARKERS, np.moveaxis(self.truth, 1, 0), strict=True))
        return SeenPerson(markers, self.rate, self.cameras, next(self.sights(1)))

    def sights(self, stop: int, views: int | None = None) -> Iterator[Sight]:
        """Pictures of the first cameras, frame after frame; the background is that of the empty room."""
        sources, features = self.sources, []
        videos = sources.videos[:views]
        for video in videos:
            plate = next(iter(sources.plates[video.camera].images()))
            hiding = sources.occlusion[video.camera] if self.announced else None
            features.append(video_features(video, _SETTINGS, plate=plate, occlusion=hiding, stop=stop, bad_mask="ignore"))
        images = [video.images() for video in videos]
        for frame in zip(*features, strict=True):
            yield Sight(frame, [next(stream) for stream in images])


@lru_cache(maxsize=4)
def see(scene: Scene) -> SeenScene:
    """Look at a scene, which is rendered unless it is there.

    Raises:
        InputError: The recording or the cache folder cannot be used.
        PosepplError: A package or OpenGL is missing.
    """
    if not scene.folder.exists():
        _render(scene)
    sources = sources_of_scene(scene.folder)
    if sources.truth is None:
        raise InputError("no truth", file=scene.folder, expected="a scene as it was rendered; remove the folder and run again")
    names = load_builder(DEFAULT_MODEL)(None).tree.marker_names
    truth = np.asarray(virtual_markers(names, sources.truth.markers), np.float64)
    return SeenScene(scene.rate, cameras_of_records(sources.records), truth, sources, scene.announced)


def _render(scene: Scene) -> None:
    scene.folder.parent.mkdir(parents=True, exist_ok=True)
    subject, toes = _subject(scene)
    setting = build_setting(
        subject.body.tree.marker_names,
        subject.complete_markers(),
        toes=toes,
        clutter=scene.clutter,
        size=(scene.width, scene.height),
    )
    try:
        film_subject(scene.folder, subject, setting)
    except InputError:
        if not scene.folder.exists():  # another process was faster
            raise


def _subject(scene: Scene) -> tuple[MovingSubject, dict[str, Floats]]:
    """Moving person, and the toes, which the body does not have; frame numbers are those of the nearest in the recording."""
    path, skeleton = scene.recording.path, scene.recording.skeleton
    if path is None:
        return walking_subject(frames=f"0:{scene.num_frames}", rate=scene.rate, turn=scene.radius), {}
    whole = read_motion(path, skeleton)
    walk = whole if scene.radius is None else turned(whole, scene.radius)
    motion = slice_frames(resample(walk, scene.rate), f"0:{scene.num_frames}")
    subject = fit_subject(motion, body_builder(DEFAULT_MODEL))
    frames = np.round(np.arange(scene.num_frames) * whole.rate / motion.rate).astype(int)
    return subject._replace(frames=frames, source=path), find_toes(motion)
