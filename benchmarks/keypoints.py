"""Keypoints of two cameras: the default tracker and its smoother against weighted linear triangulation, on a real recording.

    POSEPPL_DATA=FOLDER python benchmarks/keypoints.py [--quick] [--output keypoints]

The man on a beam of pose2sim_balancing, OpenPose's points at 60 frames a second. Cameras are those after bundle adjustment
(reference/balancing_calib_refined.npz), so that all answers share one calibration. Errors (mm) are distances of fourteen joints
from the triangulation by all four cameras, which is no truth: it has errors of its own, and shares points with what is judged.
Coverage is of the keypoints of the cameras that are left out, by intervals of the projected joints with that camera's noise.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation
from timing import arguments, show

from poseppl.cli.console import start_jax
from poseppl.experiments.tables import Table, write_csv
from poseppl.motion.geometry import project
from poseppl.motion.geometry.triangulation import triangulate
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, track
from poseppl.motion.tracking.keypoints import KeypointScene, scene_of_keypoints

PAIRS = ((1, 4), (2, 4))
_MM = 1000.0


def adjusted_cameras(folder: Path) -> list[CameraRecord]:
    """The cameras after bundle adjustment."""
    adjusted = np.load(folder / "reference" / "balancing_calib_refined.npz")
    turns, records = (
        Rotation.from_rotvec(adjusted["rvec"]).as_matrix(),
        read_cameras(folder / "calibration" / "Calib_qualisys.toml"),
    )
    shifts = _MM * adjusted["tvec"]
    return [record._replace(rotation=turns[c], translation=shifts[c]) for c, record in enumerate(records)]


def scene_of(folder: Path, cameras: tuple[int, ...], frames: str | None) -> KeypointScene:
    """What these cameras saw."""
    folders = {f"cam_0{c}": folder / "pose" / f"cam0{c}_json" for c in cameras}
    return scene_of_keypoints(folders, adjusted_cameras(folder), rate=60, refine=False, frames=frames)


def places_of(found: KeypointScene) -> Any:
    """Weighted linear triangulation (T, K, 3)."""
    data = found.scene.data
    return triangulate(found.scene.cameras, data.points, 1 / np.square(data.noise))


def coverage(draws: Any, full: KeypointScene, camera: int, rng: np.random.Generator) -> list[float]:
    """Shares of a camera's coordinates that 50 % and 90 % intervals of draws (S, T, K, 3) hold."""
    lens = jax.tree.map(lambda leaf: leaf[camera : camera + 1], full.scene.cameras)
    seen, noise = full.scene.data.points[:, camera], full.scene.data.noise[:, camera, :, None]
    images = np.stack([np.asarray(project(lens, jnp.asarray(draw, float)))[0] for draw in draws])
    images = images + noise * rng.standard_normal(images.shape)
    shares = []
    for level in (0.5, 0.9):
        low, high = np.quantile(images, [(1 - level) / 2, (1 + level) / 2], axis=0)
        shares.append(float(((seen >= low) & (seen <= high))[np.isfinite(seen)].mean()))
    return shares


def row(name: str, cameras: tuple[int, ...], means: Any, reference: Any, shares: Any) -> tuple[Any, ...]:
    """A row of the table."""
    error = np.linalg.norm(means - reference, axis=-1)
    median, worst = np.quantile(error[np.isfinite(error)], [0.5, 0.95])
    return (
        "-".join(map(str, cameras)),
        name,
        float(median),
        float(worst),
        *(np.mean(shares, 0) if shares else (np.nan, np.nan)),
    )


def main() -> None:
    """Print the table and write it to OUTPUT/keypoints.csv."""
    options = arguments(__doc__, output="keypoints")
    frames = "0:6" if options.quick else None
    folder = Path(os.environ.get("POSEPPL_DATA", "../shared/data")) / "pose2sim_balancing"
    start_jax()
    full = scene_of(folder, (1, 2, 3, 4), frames)
    reference, rows = places_of(full), []
    for cameras in PAIRS:
        found = scene_of(folder, cameras, frames)
        rows.append(row("linear triangulation", cameras, places_of(found), reference, []))
        filtered = track(found.scene, TrackSettings())
        answers = {
            "filter": filtered,
            "smoother, independent errors": smooth(filtered, SmoothSettings()),
            "smoother, lasting errors": smooth(filtered, SmoothSettings("laplace", errors="lasting")),
        }
        for name, tree in answers.items():
            draws = np.asarray(tree["posterior/markers"].values, np.float64)
            draws = draws.reshape(-1, *draws.shape[2:])
            rng = np.random.default_rng(0)
            shares = [coverage(draws, full, c, rng) for c in range(4) if c + 1 not in cameras]
            rows.append(row(name, cameras, draws.mean(0), reference, shares))
    table = Table("keypoints", ("cameras", "method", "median", "percentile_95", "coverage_50", "coverage_90"), rows)
    show(
        "Keypoints",
        table.columns,
        [[value if isinstance(value, str) else f"{value:.3g}" for value in row] for row in table.rows],
    )
    output = Path(options.output)
    output.mkdir(parents=True, exist_ok=True)
    write_csv(table, output)


if __name__ == "__main__":
    main()
