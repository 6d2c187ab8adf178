"""Cameras of one clock whose calibration is a little wrong: false offsets, and cameras with the wrong person.

    POSEPPL_DATA=FOLDER python -m studies.simulated_clocks [--quick] [--output simulated-clocks]

Walks of simulated_keypoints.py in the four cameras of the laboratory, with clutter or without; their poses are right, or off by
a third of the prior of their refinement (1 degree about each axis, 30 mm along it) or by all of it. The table has the largest
offset of the clocks, frames at 30 Hz, with its reported standard deviation. It also has the number of the three 90 % intervals
that include 0, and the number of offsets that would be corrected. The last column is the number of cameras whose person is, by
the rays, another one than in the other cameras in more than half of the frames.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
from poseppl_papers.tables import Table, shown

from benchmarks.timing import DATA, arguments
from poseppl.cli.console import start_jax
from poseppl.motion.keypoints.clocks import Clock
from poseppl.motion.keypoints.drawn_detections import detect
from poseppl.motion.keypoints.keypoint_scene import MIN_AGREEMENT
from poseppl.motion.keypoints.people import associate_person
from poseppl.motion.keypoints.sources import MIN_OFFSET, SURE, find_offsets
from poseppl.motion.tracking.placing import cameras_of_records
from studies.kept_runs import keep_run, read_runs
from studies.laboratory_rig import rig_records
from studies.simulated_keypoints import OPENSIM, WALKS, recorded

SIZES = {"0": 0.0, "1/3": 1 / 3, "1": 1.0}
"""Sizes of the cameras' errors, in units of their prior's."""
CASES = (("no", "0"), ("no", "1/3"), ("no", "1"), ("yes", "0"), ("yes", "1/3"))
"""Whether there is clutter, and the size."""
NORMAL_95 = 1.645
"""Half of a 90 % interval, in standard deviations."""
COLUMNS = ("recording", "clutter", "calibration", "offset", "deviation", "held", "mended", "lost")


def run(folder: Path, name: str, size: float, clutter: bool, seed: int) -> tuple[float, float, int, int, int]:
    """Largest offset, its standard deviation, numbers of covered and of corrected offsets, number of lost cameras."""
    subject, records = recorded(folder, name, seed), rig_records(folder)
    found = detect(subject, records, np.random.default_rng([seed, len(records)]), calibration=size, clutter=clutter)
    people, cameras = list(found.people.values()), cameras_of_records(records)
    chosen = associate_person(cameras, people, subject.rate)
    lost = int(((chosen >= 0).mean(0) < MIN_AGREEMENT).sum())
    late = find_offsets(cameras, people, [Clock()] * len(people), subject.rate)
    if late is None:
        return np.nan, np.nan, 0, 0, lost
    off, deviation = np.abs(late.frames[1:]), late.deviation[1:]
    worst = int(off.argmax())
    held, mended = off <= NORMAL_95 * deviation, (off >= MIN_OFFSET) & (off >= SURE * deviation)
    return float(off[worst]), float(deviation[worst]), int(held.sum()), int(mended.sum()), lost


def main() -> None:
    """Print and write OUTPUT/simulated_clocks.csv."""
    options = arguments(__doc__, output="simulated-clocks")
    start_jax()
    folder, output = DATA, options.output
    table = Table("simulated_clocks", COLUMNS, read_runs(output / "simulated_clocks.csv"))
    for (clutter, size), (seed, name) in product(CASES[: 1 if options.quick else None], enumerate([*WALKS, OPENSIM])):
        if (name, clutter, size) not in {row[:3] for row in table.rows}:
            found = run(folder, name, SIZES[size], clutter == "yes", seed)
            keep_run(table, (name, clutter, size, *map(shown, found)), output)


if __name__ == "__main__":
    main()
