"""The subject of predictive checks: coverage of 90 % intervals of data, coordinates and joints on recorded walks.

    POSEPPL_DATA=FOLDER python -m studies.prediction_coverage [--quick] [--filters kalman,assumed-density] [--cameras 2,1]

Each row is a walk of at most 100 frames at 30 Hz, seen by simulated cameras with noise of 0.003. The ratio is the variance of
the predicted states' errors, estimated from the innovations, over the claimed variance. The coverages are those of the data one
frame ahead, of coordinates, of the joints of the model's body at the true coordinates, and of the recorded joints.
"""

from __future__ import annotations

import itertools
from functools import partial
from pathlib import Path

import jax
import numpy as np

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.diagnostics import check_predictions, diagnose, predictive_figures
from poseppl.diagnostics.calibration import between
from poseppl.diagnostics.verdicts.predictive import prediction_of
from poseppl.motion.geometry import marker_positions
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, track
from poseppl.motion.tracking.placing import camera_names, cameras_around

WALKS: dict[str, tuple[str, str | None, int]] = {
    "12_01": ("pybvh/cmu_12_01_walk.bvh", None, 1),
    **{
        name: (f"cmu_walks/{name}.amc", f"cmu_walks/{name[:2]}.asf", 4)
        for name in ("05_01", "07_01", "08_01", "16_15", "35_01")
    },
}
"""File, skeleton and step."""


def main() -> None:
    options = arguments(__doc__, filters="kalman,assumed-density", cameras="2,1")
    start_jax()
    columns = ["walk", "filter", "cameras", "ratio", "data", "coordinates", "body's joints", "joints", "verdict"]
    rows, count = [], 8 if options.quick else 100
    counts = [int(word) for word in options.cameras.split(",")]
    for filter, cameras, walk in itertools.product(options.filters.split(","), counts, WALKS):
        rows.append([walk, filter, str(cameras), *judged(DATA, walk, cameras, filter, count)])
        print("|", " | ".join(rows[-1]), "|", flush=True)
        jax.clear_caches()
    show("Coverage of 90 % intervals, %", columns, rows)


def judged(folder: Path, walk: str, cameras: int, filter: str, count: int) -> list[str]:
    """The ratio of variances, four coverages, and the severity of the check of predictions."""
    file, skeleton, step = WALKS[walk]
    whole = recorded_subject(folder / file, skeleton and folder / skeleton, frames=f"0::{step}")
    subject = whole._replace(states=whole.states[:count], markers=whole.markers[:count], frames=whole.frames[:count])
    scene = observe_motion(subject, cameras_around(subject, count=cameras), camera_names(cameras), seed=0)
    tree = diagnose(track(scene, TrackSettings(filter=filter)).result)
    checks = prediction_of(tree)
    assert checks is not None
    figures, found = predictive_figures(checks.data), check_predictions(checks.data)
    coordinates, recorded = (tree["diagnostics"][name].sel(level=0.9).item() for name in ("coverage", "coverage_markers"))
    place = jax.vmap(partial(marker_positions, scene.body.tree))
    low, high = (tree["summary/markers_quantile"].sel(quantile=level).values for level in (0.05, 0.95))
    shares = [1 - figures.outer.estimate, coordinates, np.mean(between(low, high, np.asarray(place(subject.states)))), recorded]
    severity = found[0].severity if found else "none"
    return [f"{figures.inflation.estimate:.2f}", *(f"{100 * np.float64(share):.0f}" for share in shares), severity]


if __name__ == "__main__":
    main()
