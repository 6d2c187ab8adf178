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
from poseppl.motion.keypoints.point_errors import PointErrors
from poseppl.motion.tracking.assumed_stature import ATTRIBUTE
from poseppl.motion.tracking.body_sizes import POPULATION
from poseppl.motion.tracking.lasting_errors import POINT_ERRORS
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
        f"the person is assumed to be {mean:.2f} ± {deviation:.2f} m tall (SD), because these cameras cannot measure it; ",
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
        errors: Their noise and bias.
        refined: How the cameras differ from their calibration; None where that was not sought.
        agreement: (C,) of the frames in which a camera sees someone, the share in which it sees the person.
        confidence: (T, C, K) of the points.
        sizes: (C, 2) width and height of the pictures, px.
        reading_notes: Notes from reading the files and synchronising the clocks, a sentence each.
        associated: Which detections are the person's, and which limbs are exchanged; None where that was not sought.
        detector_errors: Known errors of the detector; None if the noise is estimated.
        chosen: (T, C) which detection of a camera is the person's, -1 where there is none, before corrections.
        num_leaps: Points that leap and count as not seen.
        size: Whether segment lengths were "given", "measured" in the points, or "assumed" to be those of a mean adult.
        point_errors: The errors of the points, as rays that miss each other tell; None with one camera.
        model: Builder of the scene's body.
    """

    scene: Scene[PointData]
    layout: str
    errors: CameraErrors
    refined: RefinedCameras | None
    agreement: Floats
    confidence: Floats
    sizes: Floats
    reading_notes: tuple[str, ...] = ()
    associated: Association | None = None
    detector_errors: DetectorErrors | None = None
    chosen: Integers | None = None
    num_leaps: int = 0
    size: Literal["given", "measured", "assumed"] = "given"
    point_errors: PointErrors | None = None
    model: str | None = None

    def record(self) -> dict[str, Any]:
        """Estimates for each camera as plain values: degrees, mm, px, and shares; None if they cannot be estimated."""
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
        known: dict[str, Any] = {} if self.detector_errors is None else {"detector errors": self.detector_errors.source}
        if self.point_errors is not None:
            known[POINT_ERRORS] = self.point_errors.record(self.scene.body.tree.marker_names)
        of_size: dict[str, dict[str, Any]] = {"measured": {"lengths measured": True}, "assumed": {ATTRIBUTE: list(POPULATION)}}
        body = {} if self.model is None else {"model": self.model}
        return {**body, "layout": self.layout, "cameras found": cameras, **pairs, **left, **known, **of_size.get(self.size, {})}

    def notes(self) -> list[str]:
        """Notes for the user, a sentence each."""
        known = (f"the layout {self.layout} (", Argument("layout"), ")") if self.layout else ("names",)
        notes = [Phrase("the keypoints have ", *known), *self.reading_notes]
        if self.size == "assumed":
            notes.append(_stature_note(len(self.scene.camera_names) == 1))
        if self.detector_errors is not None:
            notes.append(f"the detector's errors are those of {self.detector_errors.source}")
        notes += _absence_notes(np.asarray(np.isfinite(self.scene.data.points).any((1, 2, 3))), self.scene.frames)
        for name, share in zip(self.scene.camera_names, self.agreement, strict=True):
            if share < MIN_AGREEMENT:
                notes.append(
                    f"{name}: its person agrees with the other cameras' in {share:.0%} of its frames; its calibration or its "
                    "clock is wrong, or another camera's"
                )
        notes += [] if self.refined is None else _pose_notes(self.scene.camera_names, self.refined)
        notes += [] if self.associated is None else self.associated.notes(self.scene.camera_names, self.scene.frames)
        if self.num_leaps:
            leaps = f"{self.num_leaps} points jump away and back, and are treated as missing ("
            notes.append(Phrase(leaps, Argument("keep", "detections"), " keeps them)"))
        for name, scale, bias in zip(self.scene.camera_names, *self.errors, strict=True):
            if np.linalg.norm(bias) > LARGEST_BIAS * scale:
                notes.append(
                    f"{name}: points lie ({bias[0]:+.0f}, {bias[1]:+.0f}) px from where the others see them, with a noise of "
                    f"{scale:.0f} px; its calibration, or another's, may be wrong"
                )
        return notes
