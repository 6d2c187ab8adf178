"""Feet and heads of two detectors: held-out cameras and the triangulation by all, joint by joint.

    POSEPPL_DATA=FOLDER python -m studies.feet [--quick] [--output studies/tables]

The man on a beam of pose2sim_balancing, by OpenPose (BODY_25B) and by MediaPipe, 100 frames at 60 a second, with the cameras
after bundle adjustment. Three of the four cameras are smoothed (``poseppl track keypoints``), each in turn being left out.
Errors (mm) are distances from the triangulation by all four, which is no truth. Coverage is that of the keypoints of the camera
that is left out, by intervals of the projected markers with that camera's noise.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show, write_table
from poseppl.cli.console import start_jax
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking.smoothed_recording import smooth_recording
from studies.keypoints import LEVELS, adjusted_cameras, held, images_of, places_of

DETECTORS = {"OpenPose": "pose2sim_balancing/pose/cam{c:02d}_json", "MediaPipe": "mediapipe_beam/cam{c:02d}.json"}
GROUPS = {
    "feet": ("heel", "big_toe", "small_toe"),
    "face": ("nose", "eye", "ear"),
    "others": ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"),
}
CAMERAS = (1, 2, 3, 4)


def scene_of(detector: str, cameras: tuple[int, ...], frames: str | None) -> KeypointScene:
    """Detections of these cameras."""
    files = {f"cam_{c:02d}": DATA / DETECTORS[detector].format(c=c) for c in cameras}
    records = adjusted_cameras(DATA / "pose2sim_balancing")
    return scene_of_keypoints(KeypointSettings(files, records, rate=60, keep=("calibration",), frames=frames))


def held_out(detector: str, camera: int, full: KeypointScene, frames: str | None) -> tuple[Any, Any]:
    """Errors (T, K), mm, without a camera, and whether intervals include its points (levels, T, K, 2), NaN where not seen."""
    found = scene_of(detector, tuple(c for c in CAMERAS if c != camera), frames)
    tree = smooth_recording(found.scene).result
    draws = np.asarray(tree["posterior/markers"].values, np.float64).reshape(-1, *places_of(full).shape)
    images = images_of(draws, full, camera - 1, np.random.default_rng(0))
    seen = full.scene.data.points[:, camera - 1]
    inside = []
    for level in LEVELS:
        low, high = np.quantile(images, [(1 - level) / 2, (1 + level) / 2], axis=0)
        inside.append(np.where(np.isfinite(seen), (seen >= low) & (seen <= high), np.nan))
    return np.linalg.norm(draws.mean(0) - places_of(full), axis=-1), np.stack(inside)


def main() -> None:
    """Print the table and write it."""
    options = arguments(__doc__, output="studies/tables")
    frames = "0:30:3" if options.quick else None
    start_jax()
    rows = []
    for detector in DETECTORS:
        full = scene_of(detector, CAMERAS, frames)
        names = full.scene.body.tree.marker_names
        errors, inside = zip(*(held_out(detector, camera, full, frames) for camera in CAMERAS), strict=True)
        for group, parts in GROUPS.items():
            index = [k for k, name in enumerate(names) if name.removesuffix("_l").removesuffix("_r") in parts]
            own = np.stack(errors)[..., index]
            median, worst = np.nanquantile(own, [0.5, 0.95])
            shares = [np.nanmean(each[:, :, index], axis=(1, 2, 3)) for each in inside]
            rows.append((detector, group, int(np.isfinite(own).sum()), float(median), float(worst), *held(shares)))
    columns = ("detector", "markers", "places", "median", "percentile_95", "coverage_50", "coverage_90", "ece")
    shown = [[value if isinstance(value, str) else f"{value:.3g}" for value in row] for row in rows]
    show("Feet and face", columns, shown)
    if not options.quick:
        recordings = "pose2sim_balancing and mediapipe_beam, 100 frames, each of four cameras left out in turn"
        write_table(Table("feet", columns, rows), Path(options.output), "4 a detector", recordings)


if __name__ == "__main__":
    main()
