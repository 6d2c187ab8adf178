"""A detector's keypoints of a man on a beam, pose2sim_balancing, and of a second person, pose2sim_two_people."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.motion.io import read_cameras
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import MIN_CONFIDENCE, Scene, noise_of
from studies.balancing import STATURE, read_triangulation

_PARTS = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
NAMES = {f"{part.lower()}_{side.lower()}": f"{side}{part}" for part in _PARTS for side in "LR"}
"""Names of the detector by ours; markers of the trunk and head have none."""


def keypoint_scene(data: Path, count: int, noise: float, *, other: Sequence[int] = ()) -> Scene[PointData]:
    """The man's keypoints in four cameras; in some of them, the other person's instead."""
    folder = data / "pose2sim_balancing"
    records = read_cameras(folder / "calibration" / "Calib_qualisys.toml")
    with np.load(folder / "reference" / "balancing_keypoints.npz") as stored:
        known, points = [str(name) for name in stored["names"]], stored["kp"][:count]
    for camera in other:
        points[:, camera] = other_person(data, camera, count)
    body = full_body({name: value * STATURE / 1750.0 for name, value in full_body().lengths.items()})
    cameras = cameras_of_records(records)
    index = [known.index(NAMES[name]) if name in NAMES else -1 for name in body.tree.marker_names]
    ours = np.concatenate([points, np.zeros_like(points[:, :, :1])], 2)[:, :, index]
    seen = ours[..., 2] >= MIN_CONFIDENCE
    spread = noise_of(body, cameras, noise) / np.sqrt(np.clip(ours[..., 2], MIN_CONFIDENCE, 1.0))
    names = tuple(record.name for record in records)
    places = np.where(seen[..., None], ours[..., :2], np.nan)
    return Scene(body, cameras, names, PointData(places, spread), np.arange(count), 60.0, "keypoints")


def other_person(data: Path, camera: int, count: int) -> Any:
    """Keypoints (T, 25, 3) of the person whose confidence is 1 throughout; of confidence 0 where there is none."""
    found = np.zeros((count, 25, 3))
    folder = data / "pose2sim_two_people" / f"cam{camera + 1:02d}_json"
    for frame in range(count):
        people = json.loads((folder / f"cam{camera + 1:02d}.{frame:04d}.json").read_text())["people"]
        for person in people:
            points = np.array(person["pose_keypoints_2d"]).reshape(25, 3)
            if set(np.unique(points[:, 2])) <= {0.0, 1.0}:
                found[frame] = points
    return found


def triangulated(data: Path, count: int) -> Any:
    """Places (T, markers, 3) of the published triangulation, NaN for markers that it lacks."""
    reference = read_triangulation(data / "pose2sim_balancing" / "reference" / "Balancing_for_IK.trc", count)
    absent = np.full((count, 3), np.nan)
    return np.stack([reference.get(NAMES.get(name, ""), absent) for name in full_body().tree.marker_names], 1)
