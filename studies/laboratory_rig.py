"""The four cameras of a laboratory (h36m_cameras), and people who walk in their middle.

A person of a recording is put where the cameras look, and turned at random; what a detector finds there is drawn
(:mod:`poseppl.motion.keypoints.drawn_detections`).
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import body_builder
from poseppl.motion.bodies.subject import MovingSubject, fit_subject
from poseppl.motion.io import CameraRecord, read_motion
from poseppl.motion.recordings.subjects import chosen_motion
from poseppl.motion.tracking.default_body import DEFAULT_MODEL

PERSON, SIZE = "S1", (1000, 1000)
"""Person of h36m_cameras whose camera poses are used; width and height of the pictures, px."""
RIG = {4: (0, 1, 2, 3), 2: (0, 2)}
"""Which of them there are, by how many."""


def rig_records(folder: Path) -> list[CameraRecord]:
    """The four calibrated cameras; mm, the floor at Z = 0."""
    parameters = json.loads((folder / "h36m_cameras" / "camera-parameters.json").read_text())
    poses = parameters["extrinsics"][PERSON]
    return [
        CameraRecord(
            name,
            size=SIZE,
            matrix=np.array(of["calibration_matrix"]),
            distortion=np.array(of["distortion"]),
            rotation=np.array(poses[name]["R"]),
            translation=np.array(poses[name]["t"]).ravel(),
        )
        for name, of in parameters["intrinsics"].items()
    ]


def rig_middle(records: list[CameraRecord]) -> Floats:
    """The point (3,) nearest to all optical axes."""
    across = [np.eye(3) - np.outer(record.rotation[2], record.rotation[2]) for record in records]
    centres = [-record.rotation.T @ record.translation for record in records]
    return np.linalg.solve(sum(across), sum(each @ centre for each, centre in zip(across, centres, strict=True)))


def placed_subject(path: Path, skeleton: Path | None, frames: str, middle: Floats, heading: float) -> MovingSubject:
    """A recorded person who walks about the rig's middle, turned by a heading (radians)."""
    motion = chosen_motion(read_motion(path, skeleton), DEFAULT_MODEL, frames)
    cos, sin = np.cos(heading), np.sin(heading)
    turned = motion.positions @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    centre = np.nanmean(turned, (0, 1))
    shift = np.array([middle[0] - centre[0], middle[1] - centre[1], -np.nanmin(turned[..., 2])])
    return fit_subject(replace(motion, positions=turned + shift), body_builder(DEFAULT_MODEL))
