"""Keypoints of one, two and three cameras: the tracker and its smoothers against triangulation, on a real recording.

    POSEPPL_DATA=FOLDER python -m studies.keypoints [--quick] [--output keypoints]

The man on a beam of pose2sim_balancing, OpenPose's points at 60 frames a second. Cameras are those after bundle adjustment
(reference/balancing_calib_refined.npz), so that all answers share one calibration. Errors (mm) are distances of fourteen joints
from the triangulation by all four cameras, which is no truth: it has errors of its own, and shares points with what is judged.
Coverage is of the keypoints of the cameras that are left out, by intervals of the projected joints with that camera's noise;
ECE is the mean distance of coverage from its level, over levels of 10 to 90 %. One camera's person has any adult's stature.
Gates are those of Pose2Sim: confidence of at least 0.3, the cameras with the least reprojection error where that of all exceeds
15 px, none above it, gaps interpolated; its low-pass is Butterworth's of fourth order, 6 Hz, forwards and backwards.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_papers.tables import Table, write_csv
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.geometry import project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, track

SETS = ((1,), (2,), (3,), (4,), (1, 4), (2, 4), (1, 2, 4))
LEVELS = np.arange(1, 10) / 10
MIN_CONFIDENCE, LARGEST_ERROR, CUTOFF, RATE = 0.3, 15.0, 6.0, 60.0
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
    """Detections of these cameras."""
    folders = {f"cam_0{c}": folder / "pose" / f"cam0{c}_json" for c in cameras}
    return scene_of_keypoints(
        KeypointSettings(folders, adjusted_cameras(folder), rate=60, keep=("calibration",), frames=frames)
    )


def places_of(found: KeypointScene) -> Any:
    """Weighted linear triangulation (T, K, 3)."""
    data = found.scene.data
    return triangulate(found.scene.cameras, data.points, 1 / np.square(data.noise))


def reprojection(cameras: Any, points: Any, places: Any) -> Any:
    """Mean distance (T, K), px, of points (T, C, K, 2) from the projections of places."""
    seen = np.moveaxis(np.asarray(project(cameras, jnp.asarray(np.nan_to_num(places), float)), np.float64), 0, 1)
    distance = np.linalg.norm(points - seen, axis=-1)
    known = np.isfinite(distance)
    return np.where(known, distance, 0.0).sum(1) / np.maximum(known.sum(1), 1)


def gated(found: KeypointScene) -> Any:
    """Weighted linear triangulation (T, K, 3) with gates, gaps interpolated, low-passed."""
    cameras, data = found.scene.cameras, found.scene.data
    noise = found.errors.scale[:, None]
    confidence = np.square(noise / data.noise)
    points = np.where((confidence >= MIN_CONFIDENCE)[..., None], data.points, np.nan)
    count = points.shape[1]
    best, least = np.full((len(points), points.shape[2], 3), np.nan), np.full((len(points), points.shape[2]), np.inf)
    for size in range(count, 1, -1):
        open_ = least > LARGEST_ERROR  # fewer cameras only where more do not agree
        for chosen in itertools.combinations(range(count), size):
            index = np.array(chosen)
            lens = jax.tree.map(lambda leaf, index=index: leaf[index], cameras)
            places = triangulate(lens, points[:, index], confidence[:, index])
            error = np.where(np.isfinite(places).all(-1), reprojection(lens, points[:, index], places), np.inf)
            better = open_ & (error < least)
            best[better], least[better] = places[better], error[better]
    best[least > LARGEST_ERROR] = np.nan
    when = np.arange(len(best))
    low_pass = butter(2, CUTOFF, fs=RATE)
    for k, axis in itertools.product(range(best.shape[1]), range(3)):
        known = np.isfinite(best[:, k, axis])
        if known.any():
            filled = np.interp(when, when[known], best[known, k, axis])
            best[:, k, axis] = filtfilt(*low_pass, filled) if len(filled) > 9 else filled
    return best


def images_of(draws: Any, full: KeypointScene, camera: int, rng: np.random.Generator) -> Any:
    """Points (S, T, K, 2) that a camera may see, with its noise, of draws of places (S, T, K, 3)."""
    lens = jax.tree.map(lambda leaf: leaf[camera : camera + 1], full.scene.cameras)
    images = np.stack([np.asarray(project(lens, jnp.asarray(draw, float)))[0] for draw in draws])
    return images + full.scene.data.noise[:, camera, :, None] * rng.standard_normal(images.shape)


def coverage(draws: Any, full: KeypointScene, camera: int, rng: np.random.Generator) -> list[float]:
    """Shares of a camera's coordinates that intervals of draws (S, T, K, 3) hold, at each of the levels."""
    seen, images, shares = full.scene.data.points[:, camera], images_of(draws, full, camera, rng), []
    for level in LEVELS:
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
        *held(shares),
    )


def held(shares: Any) -> tuple[float, float, float]:
    """Coverage at 50 % and 90 %, and ECE, from shares (cameras, levels)."""
    if not shares:
        return np.nan, np.nan, np.nan
    mean = np.mean(shares, 0)
    return float(mean[4]), float(mean[8]), float(np.abs(mean - LEVELS).mean())


def main() -> None:
    """Print the table and write it to OUTPUT/keypoints.csv."""
    options = arguments(__doc__, output="keypoints")
    frames = "0:6" if options.quick else None
    folder = DATA / "pose2sim_balancing"
    start_jax()
    full = scene_of(folder, (1, 2, 3, 4), frames)
    reference, rows = places_of(full), []
    for cameras in SETS:
        found = scene_of(folder, cameras, frames)
        filtered = track(found.scene, TrackSettings()).result
        answers = {"filter": filtered}
        if len(cameras) == 1:
            answers["smoother, assumed density"] = smooth(filtered, SmoothSettings("assumed-density"))
        else:
            rows.append(row("linear triangulation", cameras, places_of(found), reference, []))
            rows.append(row("gates and low-pass", cameras, gated(found), reference, []))
            answers["smoother, independent errors"] = smooth(filtered, SmoothSettings())
            answers["smoother, autocorrelated errors"] = smooth(filtered, SmoothSettings("laplace", errors="lasting"))
        for name, tree in answers.items():
            draws = np.asarray(tree["posterior/markers"].values, np.float64)
            draws = draws.reshape(-1, *draws.shape[2:])
            rng = np.random.default_rng(0)
            shares = [coverage(draws, full, c, rng) for c in range(4) if c + 1 not in cameras]
            rows.append(row(name, cameras, draws.mean(0), reference, shares))
    table = Table("keypoints", ("cameras", "method", "median", "percentile_95", "coverage_50", "coverage_90", "ece"), rows)
    show(
        "Keypoints",
        table.columns,
        [[value if isinstance(value, str) else f"{value:.3g}" for value in row] for row in table.rows],
    )
    output = options.output
    write_csv(table, output)


if __name__ == "__main__":
    main()
