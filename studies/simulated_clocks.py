"""Cameras whose calibration is a little wrong, of one clock or late: wrong offsets, and cameras with the wrong person.

    POSEPPL_DATA=FOLDER python -m studies.simulated_clocks [--quick] [--output simulated-clocks]

Walks of simulated_keypoints.py in the four cameras of the laboratory, with clutter or without; their poses are right, or off by
a third of the prior of their refinement (1 degree about each axis, 30 mm along it) or by all of it. Three cameras are on time,
or late by the frames of `LATE`, up to a step. The table has the largest error of their offsets, frames at 30 Hz, with its
reported standard deviation. It also has the number of the three 90 % intervals that include the truth, and the number of
offsets that would be corrected wrongly. The last column is the number of cameras whose person is, by the rays, another one than
in the other cameras in more than half of the frames; it is counted for cameras on time.
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
LATE = {"no": (0, 0, 0, 0), "yes": (0, 5, -12, 20)}
"""Frames by which each camera is late."""
CASES = (
    *(("no", "no", "0"), ("no", "no", "1/3"), ("no", "no", "1"), ("no", "yes", "0"), ("no", "yes", "1/3")),
    *(("yes", "no", "0"), ("yes", "no", "1/3"), ("yes", "yes", "1/3")),
)
"""Whether cameras are late, whether there is clutter, and the size."""
NORMAL_95 = 1.645
"""Half of a 90 % interval, in standard deviations."""
COLUMNS = ("recording", "late", "clutter", "calibration", "error", "deviation", "covered", "wrong", "lost")


def run(
    folder: Path, name: str, late: tuple[int, ...], size: float, clutter: bool, seed: int
) -> tuple[float, float, int, int, int]:
    """Largest error of an offset, its standard deviation, numbers of covered and of wrong offsets, number of lost cameras."""
    subject, records = recorded(folder, name, seed), rig_records(folder)
    detected = detect(subject, records, np.random.default_rng([seed, len(records)]), calibration=size, clutter=clutter)
    people, cameras = list(detected.people.values()), cameras_of_records(records)
    chosen = associate_person(cameras, people, subject.rate)
    lost = int(((chosen >= 0).mean(0) < MIN_AGREEMENT).sum())
    shifted = [each._replace(frames=each.frames + by) for each, by in zip(people, late, strict=True)]
    found = find_offsets(cameras, shifted, [Clock()] * len(people), subject.rate)
    if found is None:
        return np.nan, np.nan, 0, 0, lost
    error, deviation = np.abs(found.frames - found.frames[0] - late)[1:], found.deviation[1:]
    worst = int(error.argmax())
    covered, wrong = error <= NORMAL_95 * deviation, (error >= MIN_OFFSET) & (error >= SURE * deviation)
    return float(error[worst]), float(deviation[worst]), int(covered.sum()), int(wrong.sum()), lost


def main() -> None:
    """Print and write OUTPUT/simulated_clocks.csv."""
    options = arguments(__doc__, output="simulated-clocks")
    start_jax()
    folder, output = DATA, options.output
    table = Table("simulated_clocks", COLUMNS, read_runs(output / "simulated_clocks.csv"))
    for (late, clutter, size), (seed, name) in product(CASES[: 1 if options.quick else None], enumerate([*WALKS, OPENSIM])):
        if (name, late, clutter, size) not in {row[:4] for row in table.rows}:
            found = run(folder, name, LATE[late], SIZES[size], clutter == "yes", seed)
            keep_run(table, (name, late, clutter, size, *map(shown, found)), output)


if __name__ == "__main__":
    main()
