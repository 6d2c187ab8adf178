"""Keypoints of cameras that are held out: does each detector's noise, estimated in the others, make intervals that are right?

    POSEPPL_DATA=FOLDER python -m studies.held_out_cameras [--quick] [--detectors ...] [--sets ...] [--output DIR]

The man on a beam of pose2sim_balancing, as several detectors see him in the same four videos. Each two and each three of the
cameras are smoothed as `poseppl track keypoints --keep calibration` does it; noise, its share that lasts and its time constant
are estimated in these cameras alone (poseppl.motion.keypoints.point_errors). Then the keypoints of the other cameras are
predicted: places of the joints, with Student-t errors of a scale that is as uncertain as a new camera's is. Coverage is of
coordinates; ECE is the mean distance of coverage from its level, over levels of 10 to 90 %. Cameras are those after bundle
adjustment of OpenPose's points, so that all detectors share one calibration. Nothing is chosen by what is held out.
Rows that the table in OUTPUT has are not made again.
"""

from __future__ import annotations

import itertools
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.motion.geometry import project
from poseppl.motion.keypoints.detector_errors import FREEDOM, magnifications
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking import smooth_recording
from studies.kept_runs import keep_run, read_runs
from studies.keypoints import LEVELS, adjusted_cameras
from studies.verdicts.keypoints import held_out

DETECTORS = {
    "OpenPose": "pose2sim_balancing/pose/cam0{}_json",
    "MediaPipe": "mediapipe_beam/cam0{}.json",
    "MoveNet": str(Path(__file__).parent / "detections" / "movenet_beam" / "cam0{}.json"),
}
"""Files of a camera by the detector. MoveNet's are committed: MoveNet Lightning, by the npm package @vladmandic/human 3.3.6."""
SETS = [*itertools.combinations(range(1, 5), 2), *itertools.combinations(range(1, 5), 3)]
COLUMNS = ("detector", "cameras", "held_out", "mm", "share", "lasts", *(f"coverage_{round(100 * level)}" for level in LEVELS))
_ABOUT = "Scale at the person, mm, median of keypoints; share of the errors that last; s; coverage of coordinates."


@cache
def scene_of(folder: Path, detector: str, cameras: tuple[int, ...], frames: str | None) -> KeypointScene:
    """Detections in some cameras."""
    files = {f"cam_0{c}": folder / DETECTORS[detector].format(c) for c in cameras}
    records = adjusted_cameras(folder / "pose2sim_balancing")
    return scene_of_keypoints(KeypointSettings(files, records, rate=60, keep=("calibration",), frames=frames))


def ranks(draws: Floats, found: KeypointScene, full: KeypointScene, camera: int, rng: np.random.Generator) -> Floats:
    """Ranks (T, K, 2), 0 to 1, of a held-out camera's coordinates among draws (S, T, K, 3) of the places with errors added."""
    lens = jax.tree.map(lambda leaf: leaf[camera : camera + 1], full.scene.cameras)
    assert found.point_errors is not None
    new = found.point_errors.in_new_camera()
    scale = new.scales(magnifications(lens, draws.mean(0)), full.confidence[:, camera : camera + 1])[:, 0, :, None]
    images = np.stack([np.asarray(project(lens, jnp.asarray(draw, float)), np.float64)[0] for draw in draws])
    worse = np.exp(new.uncertainty[0, :, None] * rng.standard_normal((len(draws), 1, len(new.log_mm), 1)))
    images += scale * worse * rng.standard_t(FREEDOM, images.shape)
    seen = full.scene.data.points[:, camera]
    return np.where(np.isfinite(seen), (images < seen).mean(0), np.nan)


def coverage(rank: Floats) -> list[float]:
    """Shares of ranks in intervals, at each level; NaN is left out."""
    known = rank[np.isfinite(rank)]
    return [float((np.abs(known - 0.5) <= level / 2).mean()) for level in LEVELS]


def rows_of(folder: Path, detector: str, cameras: tuple[int, ...], frames: str | None) -> list[tuple[Any, ...]]:
    """A row for each camera that is held out."""
    full, found = (scene_of(folder, detector, each, frames) for each in ((1, 2, 3, 4), cameras))
    tree, errors = smooth_recording(found.scene).result, found.point_errors
    assert errors is not None
    draws = np.asarray(tree["posterior/markers"].values, np.float64)
    draws = draws.reshape(-1, *draws.shape[2:])
    _, ours, theirs = np.intersect1d(found.scene.frames, full.scene.frames, return_indices=True)
    full = full._replace(
        confidence=full.confidence[theirs],
        scene=full.scene._replace(data=full.scene.data._replace(points=full.scene.data.points[theirs])),
    )
    estimates = float(np.exp(np.median(errors.log_mm))), errors.share, errors.lasts
    rows = []
    for camera in sorted({1, 2, 3, 4} - set(cameras)):
        shares = coverage(ranks(draws[:, ours], found, full, camera - 1, np.random.default_rng(camera)))
        cells = [f"{value:.4g}" for value in (*estimates, *shares)]
        rows.append((detector, "-".join(map(str, cameras)), str(camera), *cells))
    return rows


def main() -> None:
    """Run what is not yet in OUTPUT/held_out_cameras.csv, and print the summary."""
    options = arguments(__doc__, detectors=",".join(DETECTORS), sets="", output="held-out-cameras")
    start_jax()
    path = options.output / "held_out_cameras.csv"
    table = Table("held_out_cameras", COLUMNS, read_runs(path), _ABOUT)
    chosen = [tuple(map(int, word.split("-"))) for word in options.sets.split(",")] if options.sets else SETS
    frames = "0:12" if options.quick else None
    for detector, cameras in itertools.product(options.detectors.split(","), chosen[: 1 if options.quick else None]):
        if (detector, "-".join(map(str, cameras))) not in {tuple(row[:2]) for row in table.rows}:
            *others, last = rows_of(DATA, detector, cameras, frames)
            table.rows.extend(others)
            keep_run(table, last, options.output)
    values = [(*row[:3], *map(float, row[3:])) for row in table.rows]
    print(held_out({table.name: table._replace(rows=values)}))


if __name__ == "__main__":
    main()
