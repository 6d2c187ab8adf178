"""From the settings of a source to its scene, and to what was tracked: the commands of `poseppl track` in Python.

Example:
    A person in a detector's keypoints, smoothed without a filter::

        from poseppl.motion import KeypointSettings, track

        files = {"cam1": "pose/cam1", "cam2": "pose/cam2"}
        smoothed = track(KeypointSettings(files, "Calib.toml", rate=60)).result
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from poseppl.errors import Phrase
from poseppl.motion.io import VideoWarning, read_cameras
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings, LiveSettings, PersonSettings, smoothed_at_once
from poseppl.motion.learned import read_learned_motion
from poseppl.motion.recordings.settings import ObservationSettings, RecordingSettings
from poseppl.motion.recordings.subjects import cameras_of, subject_of
from poseppl.motion.settings import TrackSettings
from poseppl.motion.silhouettes.settings import VideoSettings
from poseppl.motion.silhouettes.video_sources import (
    DEFAULT_MODEL as OF_SILHOUETTES,
    VideoSources,
    open_sources,
    read_video_scene,
)
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.learned_prior import SILHOUETTE_NOISE, filter_of
from poseppl.motion.tracking.observations import observe_motion, scene_of_observations
from poseppl.motion.tracking.recorded_model import installed_builder
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.tracking.smoothed_recording import smooth_recording
from poseppl.motion.tracking.track import Tracked, track as track_scene
from poseppl.motion.tracking.walk import UNKNOWN_RATE
from poseppl.runs.run import Progress

Source = RecordingSettings | ObservationSettings | KeypointSettings | LiveSettings | VideoSettings
Note = Callable[[str], None]


def with_body(source: Source, settings: TrackSettings) -> tuple[Any, TrackSettings]:
    """The settings with the body, the noise and the filter that go with the source and a learned prior, where none is given.

    Keypoints themselves lead to the body, unless there is a prior.

    Raises:
        InputError: The prior cannot be read, or its body is not installed.
    """
    usual: str | None = None if isinstance(source, PersonSettings) else DEFAULT_MODEL
    changed = dict[str, Any]()
    if isinstance(source, VideoSettings):
        usual = OF_SILHOUETTES
        changed = {} if settings.prior is None else {"silhouette_noise": source.silhouette_noise or SILHOUETTE_NOISE}
    if settings.prior is not None:
        known = read_learned_motion(settings.prior)
        if source.model is None and not isinstance(source, VideoSettings):
            installed_builder(usual := known.body)
        settings = replace(settings, filter=settings.filter or filter_of(known))
    model = source.model or usual
    return replace(source, model=model, **changed), replace(settings, model=model)


def scene_of(
    source: Source, settings: TrackSettings, note: Note, *, videos: VideoSources | None = None, advance: Any = None
) -> Scene[Any]:
    """Read what a source names.

    Args:
        source: The source, with its body (:func:`with_body`).
        settings: How it is tracked: the seed is that of simulated noise, too.
        note: Is called with each sentence that the user should know.
        videos: The videos, where they are open already.
        advance: Called with 1 after each frame of videos.

    Raises:
        InputError: A file cannot be used, or nobody is seen.
    """
    scene: Scene[Any]
    notes: list[str] = []
    if isinstance(source, KeypointSettings):
        found = scene_of_keypoints(source)
        scene, notes = found.scene, found.notes()
    elif isinstance(source, VideoSettings):
        with warnings.catch_warnings(record=True) as recorded:
            warnings.simplefilter("always", VideoWarning)
            opened = videos or open_sources(source)
            scene = read_video_scene(source, opened, on_failure=settings.on_failure, advance=advance)
        notes = [str(warning.message) for warning in recorded]
    elif isinstance(source, ObservationSettings):
        wanted = {name: getattr(source, name) for name in ("frames", "rate", "noise", "stature", "lengths")}
        records = read_cameras(source.camera)
        scene = scene_of_observations(source.observations, records, model=source.model or DEFAULT_MODEL, **wanted)
    elif isinstance(source, RecordingSettings):
        subject = subject_of(source)
        notes = [Phrase(f"{source.recording}: ", recorded) for recorded in subject.notes]
        scene = observe_motion(subject, *cameras_of(source, subject), noise=source.noise, seed=settings.seed)
    else:
        raise TypeError(f"a source of {type(source).__name__} is followed frame by frame: poseppl.motion.keypoints.live")
    for each in (*notes, *(() if scene.rate else (UNKNOWN_RATE,))):
        note(each)
    return scene


def track(
    source: Source,
    settings: TrackSettings | None = None,
    *,
    note: Note = print,
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
) -> Tracked:
    """Track what a source names.

    Keypoints of several cameras are smoothed without a filter, as by the command, unless a setting or a checkpoint needs one.

    Args:
        source: The source.
        settings: How.
        note: Is called with each sentence that the user should know.
        progress: Reports the run's progress.
        checkpoint: Folder that the run is saved to after each chunk of frames.
        resume: Go on with the run that the folder has.

    Returns:
        The problem, the run (None without a filter), and the result with diagnostics.

    Raises:
        InputError: As :func:`scene_of`, or a setting is out of range.
        SmoothingError: There is no filter, and the smoothed states are not finite.
        TrackStopped: The run cannot go on; has the result of the frames before.
        RunError: It cannot go on from the first frame.
        CheckpointError: The folder has another run.
    """
    source, settings = with_body(source, settings or TrackSettings())
    scene = scene_of(source, settings, note)
    if smoothed_at_once(source, settings) and checkpoint is None and not resume:
        return smooth_recording(scene, settings)
    return track_scene(scene, settings, progress=progress, checkpoint=checkpoint, resume=resume)
