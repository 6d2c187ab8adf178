"""Recorded walks as the keypoints of one camera: errors of a person of unknown stature, and coverage.

    POSEPPL_DATA=FOLDER python -m studies.one_camera [--quick] [--output one-camera]

The people and the errors of simulated_keypoints.py without clutter, two of the laboratory's cameras for each, one at a time.
They are tracked as `poseppl track keypoints` does with one camera: a body of the mean adult's lengths, draws of whose stature
are moved along the rays; noise by poseppl.motion.keypoints.single_camera ("beside"), and the body's own ("body"); steps of
the walk as published, and mean-reverting ones; by the filter, by its own backward pass, and by Laplace's approximation. A row a
recording, camera, noise, walk and method: median error of the joints, mm, how much farther from the camera than the truth they
are on average, mm, and the shares of their coordinates in central intervals. Rows go to one_camera.csv in the folder, and what
is there is not run again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.drawn_detections import LAYOUT, detect
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, track
from studies.kept_runs import keep_run, read_runs
from studies.laboratory_rig import RIG, rig_records
from studies.simulated_keypoints import OPENSIM, WALKS, recorded

NAMES, LEVELS = (*WALKS, OPENSIM), (0.5, 0.9)
CAMERAS = ("first", "second")
CASES = (("beside", "mean-reverting"), ("beside", "fixed"), ("body", "fixed"))
"""Noise and walk."""
SMOOTHERS = ("assumed-density", "laplace")
COLUMNS = ("recording", "camera", "noise", "walk", "method", "error", "farther", "coverage_50", "coverage_90")
_ABOUT = "Joints seen by one camera: median error and how much farther than the truth, mm, and shares in 50 and 90 % intervals."


def answers(name: str, camera: str, noise: str, walk: Any) -> dict[str, tuple[float, ...]]:
    """Error, distance and coverage of a recording, by method."""
    seed, later = NAMES.index(name), CAMERAS.index(camera)
    subject = recorded(DATA, name, seed)
    records = [rig_records(DATA)[RIG[4][(seed + later) % 4]]]
    detected = detect(subject, records, np.random.default_rng([seed, 1 + later]), clutter=False)
    known = subject.body.noise if noise == "body" else None
    found = scene_of_keypoints(KeypointSettings(detected.people, records, rate=subject.rate, keep=("clocks",), noise=known))
    filtered = track(found.scene, TrackSettings(walk=walk)).result
    trees = {"filter": filtered} | {method: smooth(filtered, SmoothSettings(method)) for method in SMOOTHERS}
    markers = list(subject.body.tree.marker_names)
    seen = [markers.index(marker) for marker in markers_of_names(LAYOUTS[LAYOUT]) if marker in markers]
    truth = detected.places[found.scene.frames][:, seen]
    centre = np.asarray(found.scene.cameras.centre[0], np.float64)
    return {
        method: scores(np.asarray(tree["posterior/markers"].values, np.float64)[..., seen, :], truth, centre)
        for method, tree in trees.items()
    }


def scores(draws: Floats, truth: Floats, centre: Floats) -> tuple[float, ...]:
    """Median error, mean distance beyond the truth, and coverage of draws (chains, draws, T, K, 3)."""
    flat = draws.reshape(-1, *truth.shape)
    error, away = flat.mean(0) - truth, truth - centre
    farther = np.sum(error * away, -1) / np.linalg.norm(away, axis=-1)
    ends = [np.quantile(flat, [(1 - level) / 2, (1 + level) / 2], axis=0) for level in LEVELS]
    shares = [float(((low <= truth) & (truth <= high)).mean()) for low, high in ends]
    return float(np.median(np.linalg.norm(error, axis=-1))), float(farther.mean()), *shares


def main() -> None:
    options = arguments(__doc__, output="one-camera")
    start_jax()
    table = Table("one_camera", COLUMNS, read_runs(options.output / "one_camera.csv"), _ABOUT)
    done = {tuple(row[:4]) for row in table.rows}
    runs = [(name, camera, *case) for case in CASES for camera in CAMERAS for name in NAMES]
    for run in runs[: 1 if options.quick else None]:
        if run not in done:
            for method, values in answers(*run).items():
                keep_run(table, (*run, method, *(f"{value:.4g}" for value in values)), options.output)
    show("Joints in one camera", COLUMNS, [[str(value) for value in row] for row in table.rows])


if __name__ == "__main__":
    main()
