"""Settings of a detector's keypoints: what is read, of which cameras and whom, and what is corrected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from poseppl.errors import Argument, InputError, Phrase
from poseppl.motion.settings import (
    Builder,
    CameraFiles,
    File,
    Frames,
    Noise,
    Seconds,
    Settings,
    Stature,
    TrackSettings,
    Within,
    at_least,
)

Layout = Literal["coco17", "coco23", "coco18", "body25", "body25b", "halpe26", "mediapipe33"]
"""Those of :mod:`poseppl.motion.io.keypoint_layouts`."""
Detector = Literal[
    "openpose",
    "alphapose",
    "mmpose",
    "mediapipe",
    "deeplabcut",
    "sleap",
    "caliscope",
    "ultralytics",
    "vitpose",
    "freemocap",
]
"""Those of :mod:`poseppl.motion.io.keypoints`."""


@dataclass(frozen=True)
class PersonSettings(CameraFiles):
    """Settings that recordings and live folders of a person's keypoints share.

    Attributes:
        detector: Program that wrote the files. Default: detected from their content.
        layout: Names and order of the points. Default: detected from the points.
        person: Person to track: 1 is the one who is seen best, 2 the next.
        stature: Height of the person, mm, whose segments are in proportion. Default: segments are measured by several cameras;
            any adult's in one.
        lengths: File of segment lengths that are known, mm: lines such as thigh = 435.0. Default: none.
        model: Body to track, package.module:builder or FILE.py:builder. Default: poseppl_models.bodies.footed:footed_body for
            points with heels and toes, poseppl_models.bodies.choo_fleet:full_body for others.
        noise: Standard deviation of the points as a fraction of the focal length, or the file of the detector's errors by
            keypoint and confidence that poseppl calibrate-detector writes. Default: estimated in the recording, by keypoint,
            camera and confidence, from by how much the rays of several cameras miss each other.
        keep: Inputs to use without correction: frame numbers (clocks), the cameras' poses (calibration), and the
            detector's points, sides and identities (detections). Default: all are corrected, and each correction is reported.
    """

    detector: Detector | None = None
    layout: Layout | None = None
    person: Annotated[int, at_least(1)] = 1
    stature: Stature | None = None
    lengths: File | None = None
    model: Builder | None = None
    noise: Noise | File | Any = None
    keep: tuple[Literal["clocks", "calibration", "detections"], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        own = {camera: known.rate for camera, known in self.cameras.items() if known.rate is not None}
        for camera, rate in own.items():
            if not 1e-3 <= rate <= 1e5:
                expected = "0.001 to 100000 frames a second"
                raise InputError(f"{camera}:rate={rate:g}", field=Argument("camera"), expected=expected)
        if own and self.rate is None:
            problem = Phrase("a camera's rate needs that of the others, ", Argument("rate"))
            raise InputError(problem, field=Argument("camera"))


@dataclass(frozen=True)
class KeypointSettings(PersonSettings):
    """How a detector's keypoints of a person are read.

    Attributes:
        frames: Frames A:B:C of those that the cameras have in common: A to B - 1 in steps of C, counted from 0. Default: all.
    """

    frames: Frames | None = None


@dataclass(frozen=True)
class LiveSettings(PersonSettings):
    """How folders are followed that a detector is writing a person's keypoints to, one file a frame.

    Frames with the same number are simultaneous, and left and right are the detector's.

    Attributes:
        start: Length of the first frames with a person, s, from which size, noise and first pose are estimated.
        wait: Longest wait for a camera's file after another camera has the frame, s.
        idle: The run ends after so long without a new frame, s.
    """

    start: Seconds = 1.0
    wait: Seconds = 1.0
    idle: Annotated[float, Within("a positive number of seconds", lambda seconds: seconds > 0, "s")] = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_one_clock()
        if self.detector not in (None, "openpose", "mmpose"):
            problem = f"live folders have one file a frame, not those of {self.detector}"
            raise InputError(problem, field=Argument("detector"), expected="openpose or mmpose")


_OF_A_FILTER = ("filter", "options", "prior", "devices", "history_mib", "chunk", "on_failure")
"""Settings that only a filter reads; it runs where one is not as usual."""


def smoothed_at_once(source: Settings, settings: TrackSettings) -> bool:
    """Whether a recording is smoothed without a filter: keypoints of several cameras, where no setting asks for a filter."""
    several, usual = isinstance(source, KeypointSettings) and len(source.files) > 1, TrackSettings()
    return several and all(getattr(settings, name) == getattr(usual, name) for name in _OF_A_FILTER)
