"""Pose2Sim: its triangulation, and its filtering after it, with its default configuration, on files in a temporary folder.

Defaults: confidence of at least 0.3, cameras with too large an error left out (15 px), and gaps of at most 20 frames
interpolated, others filled with the last value. Then outliers are rejected, and Butterworth's low-pass of fourth order has 6
Hz. The only other settings are the project's folder, layout BODY_25B, 60 frames a second, no figures, no C3D. It gets
OpenPose's files with the right person alone and the fourteen joints. Seconds hold the reading and writing of files. Frames that
it trims have no place.
"""

from __future__ import annotations

import json
import logging
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from given import Answer, Given
from Pose2Sim import Pose2Sim
from scipy.spatial.transform import Rotation

NAME, PACKAGE = "Pose2Sim", "pose2sim"
NAMES = {
    "skull": "Neck",
    "crown": "Head",
    **{
        f"{part}_{side}": side.upper() + part.title()
        for side in "lr"
        for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    },
}
"""Its names of the joints."""
POINTS = 25
UNTOLD = {"display_figures": False, "save_filt_plots": False, "make_c3d": False}


def calibration(given: Given) -> str:
    """Its calibration file's text; lengths are in metres."""
    lines = []
    for c, number in enumerate(given.cameras):
        pose = Rotation.from_matrix(given.rotation[c]).as_rotvec(), given.translation[c] / 1000.0
        values = {"size": given.size[c].astype(float), "matrix": given.matrix[c], "distortions": given.distortion[c][:4]}
        lines += [f"[cam_{number:02d}]", f'name = "cam_{number:02d}"', "fisheye = false"]
        lines += [f"{key} = {value.tolist()}" for key, value in {**values, "rotation": pose[0], "translation": pose[1]}.items()]
    return "\n".join([*lines, "[metadata]", "adjusted = false", "error = 0.0", ""])


def write_project(folder: Path, given: Given) -> dict[str, Any]:
    """A project in a folder, and its configuration."""
    shutil.copy(Path(Pose2Sim.__file__).parent / "Demo_SinglePerson" / "Config.toml", folder)
    (folder / "calibration").mkdir()
    (folder / "calibration" / "Calib.toml").write_text(calibration(given))
    for c, number in enumerate(given.cameras):
        place = folder / "pose" / f"cam{number:02d}_json"
        place.mkdir(parents=True)
        for frame, (points, confidence) in enumerate(zip(given.points[:, c], given.confidence[:, c], strict=True)):
            person = np.zeros((POINTS, 3))
            seen = np.isfinite(points).all(-1)
            person[given.layout[seen]] = np.c_[points[seen], confidence[seen]]
            people = {"people": [{"pose_keypoints_2d": person.ravel().tolist()}]}
            (place / f"cam{number:02d}.{frame:04d}.json").write_text(json.dumps(people))
    return {
        "project": {"project_dir": str(folder), "frame_rate": int(given.rate)},
        "pose": {"pose_model": "BODY_25B"},
        "triangulation": {"make_c3d": False},
        "filtering": UNTOLD,
    }


def read_places(path: Path, given: Given) -> Any:
    """Places (T, K, 3), mm, of a TRC file whose x, y and z are the world's y, z and x."""
    lines = path.read_text().splitlines()
    names = [word for word in lines[3].split("\t")[2:] if word.strip()]
    places = np.full((len(given.points), len(given.names), 3), np.nan)
    for line in lines[5:]:
        words = line.split("\t")
        if line.strip():
            row = np.array([float(word) if word.strip() else np.nan for word in words[2 : 2 + 3 * len(names)]]).reshape(-1, 3)
            found = row[[names.index(NAMES[str(name)]) for name in given.names]][:, [2, 0, 1]]
            places[int(words[0])] = np.where((found == 0).all(-1, keepdims=True), np.nan, 1000.0 * found)
    return places


def methods(given: Given) -> dict[str, Callable[[], Answer]]:
    """Methods that are compared."""

    def run() -> Answer:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "trial"
            folder.mkdir()
            configuration = write_project(folder, given)
            Pose2Sim.triangulation(configuration)
            Pose2Sim.filtering(configuration)
            logging.shutdown()
            [path] = (folder / "pose-3d").glob("*_filt_*.trc")
            return Answer(read_places(path, given))

    return {"triangulation and filtering": run}
