"""How long recordings of four cameras are smoothed: seconds and memory by the number of frames, which they grow with.

    POSEPPL_DATA=FOLDER python -m benchmarks.long_keypoints [--quick] [--output long-keypoints]

The built-in walk goes along a circle in the middle of four calibrated cameras (h36m_cameras) at 60 frames a second. A detector
of 25 points sees it, with errors drawn from the tracker's own programs (studies/laboratory_rig.py). Detections in memory become
points of a person, and these a smoothed result. Each length runs in a process of its own, which has compiled nothing; memory is
the largest that it had. Errors are distances of joints from the true ones. The goal is that 10,000 frames take less than 300
seconds and 4,096 MiB.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import numpy as np
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, peak_memory, show, without_compile_cache, write_table
from poseppl.cli.console import start_jax
from poseppl.motion.keypoints.drawn_detections import detect
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.sources import Clocks
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import smooth_recording
from studies.laboratory_rig import rig_middle, rig_records

NAME, LENGTHS, RATE, CIRCLE = "long_keypoints", (1000, 2500, 5000, 10_000), 60.0, 1200.0
_COLUMNS = ("frames", "read_seconds", "read_processor", "seconds", "processor", "memory", "error", "error_95")
_ABOUT = "Seconds by the clock and of the processor for points of a person and for smoothing; MiB; errors of joints, mm."


def measured(num_frames: int) -> dict[str, float]:
    """One recording of this length, in this process."""
    start_jax()
    without_compile_cache()
    records = rig_records(DATA)
    subject = walking_subject(frames=f"0:{num_frames}", rate=RATE, turn=CIRCLE)
    middle, own = rig_middle(records), np.nanmean(subject.markers, (0, 1))
    shift = np.array([middle[0] - own[0], middle[1] - own[1], -np.nanmin(subject.markers[..., 2])])
    subject = subject._replace(markers=subject.markers + shift)
    detected = detect(subject, records, np.random.default_rng(0), clutter=False, exchange=False)
    marks = [(time.perf_counter(), time.process_time())]
    found = scene_of_keypoints(detected.people, records, rate=RATE, clocks=Clocks(RATE, find=False))
    marks.append((time.perf_counter(), time.process_time()))
    tree = smooth_recording(found.scene).result
    marks.append((time.perf_counter(), time.process_time()))
    seen = np.isfinite(found.scene.data.points).any((0, 1, 3))
    places = detected.places[found.scene.frames - int(found.scene.frames[0])]
    distance = np.linalg.norm(tree["summary/markers_mean"].to_numpy() - places, axis=-1)[:, seen]
    median, worst = np.nanquantile(distance, [0.5, 0.95])
    parts = [float(value) for value in np.diff(np.array(marks), axis=0).ravel()]
    return dict(zip(_COLUMNS, (num_frames, *parts, peak_memory(), float(median), float(worst)), strict=True))


def main() -> None:
    """Print the table and write it to OUTPUT."""
    options = arguments(__doc__, frames=0, output="long-keypoints")
    if options.frames:
        print(json.dumps(measured(options.frames)))
        return
    rows: list[tuple[Any, ...]] = []
    for length in (120, 240) if options.quick else LENGTHS:
        command = [sys.executable, "-m", "benchmarks.long_keypoints", "--frames", str(length), "--output", str(options.output)]
        printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        rows.append(tuple(json.loads(printed.splitlines()[-1]).values()))
    write_table(Table(NAME, _COLUMNS, rows, _ABOUT), options.output, "1", "h36m_cameras", "nothing from the compile cache")
    show("Recordings of four cameras", list(_COLUMNS), [[f"{value:,.1f}" for value in row] for row in rows])


if __name__ == "__main__":
    main()
