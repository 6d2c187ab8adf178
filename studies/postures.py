"""How people hold themselves: the numbers of ``poseppl_models.bodies.joint_angles``, from the recordings that they are of.

    POSEPPL_DATA=FOLDER python -m studies.postures [--quick] [--output postures]

The 28-DOF body is fitted to every fourth frame of walks of eight people, of punches and strikes, and of bending over; each of
these three counts as much as the others. A row an angle of the trunk or the left side, those of the right side mirrored:
mean and standard deviation, radians, and those that the module holds.
"""

from __future__ import annotations

import numpy as np
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.joint_angles import LEFT
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show, write_table
from poseppl.arrays import Floats
from poseppl.motion.recordings.subjects import recorded_subject

NAME, STEP, LEAST = "postures", 4, 0.05
WALKS = (
    *(("cmu_amc/02_01.amc", "cmu_amc/02.asf"), ("cmu_amc/03_01.amc", "cmu_amc/03.asf")),
    *(("pybvh/cmu_12_01_walk.bvh", None), ("cmu_expmap/train_walking/walking_1.txt", "cmu_expmap/skeleton.json")),
    *((f"cmu_walks/{trial}.amc", f"cmu_walks/{trial[:2]}.asf") for trial in ("05_01", "06_01", "07_01", "08_01", "08_10")),
    *((f"cmu_walks/{trial}.amc", f"cmu_walks/{trial[:2]}.asf") for trial in ("16_15", "16_47", "35_01", "35_28")),
)
MOTIONS = {
    "walks": WALKS,
    "punches": (("cmu_amc/02_05.amc", "cmu_amc/02.asf"),),
    "bending": (("cmu_amc/02_06.amc", "cmu_amc/02.asf"),),
}
_COLUMNS = ("joint", "axis", "mean", "deviation", "mean held", "deviation held")
_ABOUT = "Angles of recorded people, radians, beside the numbers of poseppl_models.bodies.joint_angles."


def angles(recordings: tuple[tuple[str, str | None], ...]) -> Floats:
    """States (T, d) of the recordings, and their mirror images."""
    frames = f"::{STEP}"
    found = [recorded_subject(DATA / path, skeleton and DATA / skeleton, frames=frames).states for path, skeleton in recordings]
    states = np.concatenate(found)
    coordinates = list(full_body().tree.coordinates)
    other = {"_l": "_r", "_r": "_l"}
    mirror = [coordinates.index((joint[:-2] + other.get(joint[-2:], joint[-2:]), axis)) for joint, axis in coordinates]
    signs = np.array([-1.0 if axis in ("Y", "Z", "tx") else 1.0 for _, axis in coordinates])
    return np.concatenate([states, states[:, mirror] * signs])


def main() -> None:
    options = arguments(__doc__, output=NAME)
    motions = [angles(recordings[:1] if options.quick else recordings) for recordings in MOTIONS.values()]
    mean = np.mean([states.mean(0) for states in motions], 0)
    square = np.mean([np.square(states - mean).mean(0) for states in motions], 0)
    coordinates = list(full_body().tree.coordinates)
    rows = []
    for (joint, axis), held in LEFT.items():
        index = coordinates.index((joint if (joint, axis) in coordinates else f"{joint}_l", axis))
        numbers = mean[index], np.sqrt(square[index] + LEAST**2), *held
        rows.append((joint, axis, *(f"{number:.2f}" for number in numbers)))
    show("Angles, rad", _COLUMNS, rows)
    write_table(Table(NAME, _COLUMNS, rows, _ABOUT), options.output, "1", "cmu_amc, cmu_expmap, cmu_walks, pybvh")


if __name__ == "__main__":
    main()
