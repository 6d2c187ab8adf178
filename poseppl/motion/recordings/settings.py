"""Settings of recordings: a motion capture file seen through simulated cameras, and points that come without a truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from poseppl.errors import Argument, InputError, Phrase
from poseppl.motion.settings import (
    Axis,
    Builder,
    File,
    FileOrFolder,
    Frames,
    Noise,
    Rate,
    Settings,
    Stature,
    Within,
    within,
)

CAMERAS, DISTANCE, VIEW = 1, 5000.0, 90.0
"""Cameras that are placed, their distance from the path, mm, and from where the first one sees it, degrees."""


@dataclass(frozen=True)
class RecordingSettings(Settings):
    """Whose motion is seen by which cameras.

    Attributes:
        recording: Motion capture file: .bvh, .c3d or .trc; .amc, or .txt of DeepMimic or exponential maps, with a skeleton.
            Default: a built-in walk.
        skeleton: Skeleton of an .amc recording; character of a DeepMimic motion; .json of exponential maps. Default: none.
        names: File that maps markers to points of the recording, for unusual names: lines such as
            knee_l = "lShin", or neck = ["C7", "CLAV"] for the mean of several. Default: found from the names.
        lengths: File of segment lengths that are known, mm: lines such as thigh = 435.0. Default: measured.
        model: Body to track, package.module:builder or FILE.py:builder. Default: poseppl_models.bodies.choo_fleet:full_body;
            lower_body and arm are there too, with all other joints clamped to the truth.
        frames: Frames A:B:C, A to B - 1 in steps of C, counted from 0; each part may be left out. Default: all; 0:60 of the
            built-in walk.
        rate: Frames a second, where the file does not say. Default: 120 for .amc and exponential maps, otherwise 30.
        scale: Millimetres a unit of a .bvh file. Default: found from the skeleton's height.
        up: Axis that points up in a .bvh, .c3d or .trc file. Default: the axis along which the head is
            above the feet; it is reported.
        camera: File of calibrated cameras, poseppl's or anipose's. Default: cameras are placed around the subject.
        cameras: How many cameras are placed, 1 to 4, each at a right angle to the one before. Default: 1.
        camera_distance: Distance of placed cameras from the subject's path, mm. Default: 5000.
        view: Direction from which the first placed camera sees the walk, degrees: 90 the right side, 0 the front, 180 the back.
            Default: 90.
        noise: Standard deviation of the image noise as a fraction of the focal length: 0.003 is 3 mm at 1 m, and 3 px at a
            focal length of 1000 px. Default: the body's, 0.003.
    """

    recording: File | None = None
    skeleton: File | None = None
    names: File | None = None
    lengths: File | None = None
    model: Builder | None = None
    frames: Frames | None = None
    rate: Rate | None = None
    scale: Annotated[float, Within("a positive number of millimetres", lambda scale: 0 < scale < 1e6, "mm")] | None = None
    up: Axis | None = None
    camera: FileOrFolder | None = None
    cameras: Annotated[int, within(1, 4)] | None = None
    camera_distance: Annotated[float, within(100, 1e6, "mm")] | None = None
    view: Annotated[float, within(-360, 360, "degrees")] | None = None
    noise: Noise | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("skeleton", "scale", "up", "names", "lengths") if self.recording is None else ():
            if getattr(self, name) is not None:
                raise InputError("the built-in walk takes none", field=Argument(name), expected="a recording with it")
        for name in ("cameras", "camera_distance", "view") if self.camera is not None else ():
            if getattr(self, name) is not None:
                expected = Phrase("no ", Argument("camera"), " with it")
                raise InputError("cameras come from the file", field=Argument(name), expected=expected)


@dataclass(frozen=True)
class ObservationSettings(Settings):
    """Points of a body's markers that come without a truth.

    Attributes:
        observations: Table of 2-D points, .csv: columns frame, marker, x, y, and where wanted camera and confidence; absent
            rows are missing markers.
        camera: File of the calibrated cameras, poseppl's or anipose's.
        frames: Frames A:B:C of the table: A to B - 1 in steps of C, counted from 0. Default: all.
        rate: Frames a second. Default: 30, which is reported.
        noise: Standard deviation of the points as a fraction of the focal length. Default: the body's, 0.003.
        stature: Height of the person, mm, whose segments are in proportion. Default: the body's.
        lengths: File of segment lengths that are known, mm: lines such as thigh = 435.0. Default: those of the stature.
        model: Body to track, package.module:builder or FILE.py:builder. Default: poseppl_models.bodies.choo_fleet:full_body.
    """

    observations: File
    camera: FileOrFolder
    frames: Frames | None = None
    rate: Rate | None = None
    noise: Noise | None = None
    stature: Stature | None = None
    lengths: File | None = None
    model: Builder | None = None
