"""A scene of a detector's keypoints, with what was found on the way to it, and the notes on it that the user reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, Phrase
from poseppl.motion.keypoints.camera_errors import CameraErrors
from poseppl.motion.keypoints.camera_refinement import RefinedCameras
from poseppl.motion.keypoints.data_association import Association
from poseppl.motion.keypoints.detector_errors import DetectorErrors
from poseppl.motion.tracking.assumed_stature import ATTRIBUTE
from poseppl.motion.tracking.body_sizes import POPULATION
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import Scene

TOLD_ANGLE, TOLD_POSITION = 0.5, 20.0
"""A camera that is turned by more degrees or moved by more mm than these is reported."""
MIN_AGREEMENT = 0.5
"""A camera whose detections fit those of the others in a smaller share of the frames in which it sees someone is reported."""
LARGEST_BIAS = 0.5
"""A camera whose points are off by more than this share of their noise in the same direction may be calibrated wrongly."""
MIN_ABSENCE = 5
"""Frames in a row in which no camera sees the person that are reported."""


def _stature_note(alone: bool) -> Phrase:
    """That a stature is assumed, of one camera alone or of several."""
    mean, deviation = (value / 1000 for value in POPULATION)
    return Phrase(
        f"the person is taken to be {mean:.2f} +- {deviation:.2f} m tall (SD), because these cameras cannot tell; ",
        Argument("stature"),
        " or ",
        Argument("lengths"),
        " set it. A person who is 1 % taller is 1 % farther away, which the intervals "
        + ("include" if alone else "do not include"),
    )


def _pose_notes(names: Sequence[str], refined: RefinedCameras) -> list[str]:
    """A sentence for each camera that is turned or moved by much, the worst first."""
    turns, shifts = np.rad2deg(np.linalg.norm(refined.turn, axis=-1)), np.linalg.norm(refined.shift, axis=-1)
    return [
        Phrase(
            f"{names[c]}: its calibration is off by {turns[c]:.1f} degrees and {shifts[c]:.0f} mm, or another's is; this is "
            "corrected (",
            Argument("keep", "calibration"),
            " disables it)",
        )
        for c in np.argsort(-turns)
        if turns[c] > TOLD_ANGLE or shifts[c] > TOLD_POSITION
    ]


def _absence_notes(seen: NDArray[np.bool_], numbers: Integers) -> list[str]:
    """How many of the frames (T,) in stretches in which no camera sees the person, and from when to when the longest is."""
    stretches = [rows for rows in np.split(np.arange(len(seen)), np.flatnonzero(np.diff(seen)) + 1) if not seen[rows[0]]]
    stretches = [rows for rows in stretches if len(rows) >= MIN_ABSENCE]
    if not stretches:
        return []
    longest = numbers[max(stretches, key=len)]
    return [
        f"no camera sees the person in {sum(map(len, stretches))} of {len(seen)} frames, the longest gap from frame "
        f"{longest[0]} to {longest[-1]}; positions there are predictions"
    ]


class KeypointScene(NamedTuple):
    """A scene, and what was found on the way to it.

    Attributes:
        scene: The scene.
        layout: Which points the detector's are.
        errors: What remains of them.
        refined: How the cameras differ from their calibration; None where that was not sought.
        agreement: (C,) of the frames in which a camera sees someone, the share in which it sees the person.
        confidence: (T, C, K) of the points.
        sizes: (C, 2) width and height of the pictures, px.
        told: What reading the files and bringing their clocks together found, a sentence each.
        associated: Which detections are the person's, and which limbs are exchanged; None where that was not sought.
        detector_errors: What was known of the detector's errors; None where the noise is measured.
        chosen: (T, C) which detection of a camera is the person's, -1 where there is none, before it was mended.
        num_leaps: Points that leap and count as not seen.
        size: Whether segment lengths were "given", "measured" in the points, or "assumed" to be those of a mean adult.
    """

    scene: Scene[PointData]
    layout: str
    errors: CameraErrors
    refined: RefinedCameras | None
    agreement: Floats
    confidence: Floats
    sizes: Floats
    told: tuple[str, ...] = ()
    associated: Association | None = None
    detector_errors: DetectorErrors | None = None
    chosen: Integers | None = None
    num_leaps: int = 0
    size: Literal["given", "measured", "assumed"] = "given"

    def record(self) -> dict[str, Any]:
        """What was found of each camera as plain values: degrees, mm, px, and shares; None where it cannot be told."""
        turns, shifts = (None, None) if self.refined is None else (self.refined.turn, self.refined.shift)
        cameras = {
            name: {
                "turned": None if turns is None else round(float(np.rad2deg(np.linalg.norm(turns[c]))), 3),
                "moved": None if shifts is None else round(float(np.linalg.norm(shifts[c])), 2),
                "noise": round(float(self.errors.scale[c]), 3) if np.isfinite(self.errors.scale[c]) else None,
                "agreement": round(float(self.agreement[c]), 4),
            }
            for c, name in enumerate(self.scene.camera_names)
        }
        pairs = {} if self.associated is None else {"limb pairs": list(self.associated.pairs)}
        left = {} if self.refined is None else {"camera covariance": self.refined.covariance.tolist()}
        known = {} if self.detector_errors is None else {"detector errors": self.detector_errors.source}
        of_size: dict[str, dict[str, Any]] = {"measured": {"lengths measured": True}, "assumed": {ATTRIBUTE: list(POPULATION)}}
        return {"layout": self.layout, "cameras found": cameras, **pairs, **left, **known, **of_size.get(self.size, {})}

    def notes(self) -> list[str]:
        """What the user should know, a sentence each."""
        known = (f"for {self.layout} (", Argument("layout"), ")") if self.layout else ("by their names",)
        told = [Phrase("keypoints are read ", *known), *self.told]
        if self.size == "assumed":
            told.append(_stature_note(len(self.scene.camera_names) == 1))
        if self.detector_errors is not None:
            told.append(f"the detector's errors are those of {self.detector_errors.source}")
        told += _absence_notes(np.asarray(np.isfinite(self.scene.data.points).any((1, 2, 3))), self.scene.frames)
        for name, share in zip(self.scene.camera_names, self.agreement, strict=True):
            if share < MIN_AGREEMENT:
                told.append(
                    f"{name}: the person it sees is the others' in {share:.0%} of its frames; its calibration or its clock is "
                    "wrong, or another camera's"
                )
        told += [] if self.refined is None else _pose_notes(self.scene.camera_names, self.refined)
        told += [] if self.associated is None else self.associated.notes(self.scene.camera_names, self.scene.frames)
        if self.num_leaps:
            leaps = f"{self.num_leaps} points leap away and back, and count as not seen ("
            told.append(Phrase(leaps, Argument("keep", "detections"), " keeps them)"))
        for name, scale, bias in zip(self.scene.camera_names, *self.errors, strict=True):
            if np.linalg.norm(bias) > LARGEST_BIAS * scale:
                told.append(
                    f"{name}: points lie ({bias[0]:+.0f}, {bias[1]:+.0f}) px from where the others see them, with a noise of "
                    f"{scale:.0f} px; its calibration, or another's, may be wrong"
                )
        return told
