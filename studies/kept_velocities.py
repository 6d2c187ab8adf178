"""Do people keep their velocity? Motion over several frames, against walks with independent steps and with velocities.

    POSEPPL_DATA=FOLDER python -m studies.kept_velocities [--quick]

The table has mean squared displacements of the coordinates over some frames, in units of those over one frame: the median over
coordinates and recordings of studies/simulated_keypoints.py, at 30 Hz. Independent steps grow linearly with time. The walk with
velocities follows the covariance of its steps (`poseppl.motion.tracking.walk.velocity_steps`). A walker turns back after half a
stride; neither model knows this.
"""

from __future__ import annotations

import numpy as np

from benchmarks.timing import DATA, arguments
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.motion.tracking.walk import velocity_steps
from studies.simulated_keypoints import OPENSIM, WALKS, recorded

FRAMES, RATE = (1, 2, 4, 8, 16), 30.0


def squared_ways(states: Floats) -> Floats:
    """Mean squares (frames, d) of ways over frames, of states (T, d), in units of those over one; NaN of what does not move."""
    squares = np.stack([np.square(states[n:] - states[:-n]).mean(0) for n in FRAMES])
    return np.asarray(squares / np.where(squares[0] > 0, squares[0], np.nan))


def expected_ways() -> Floats:
    """The same (frames,) of the walk with velocities."""
    kept, step, way = (float(each[0]) for each in velocity_steps(np.array([1 / RATE])))
    moves, along = np.array([[1.0, step * (1 + kept)], [0.0, kept]]), np.array([step, 1.0])
    covariance, variances = np.diag([0.0, 1.0]), []
    for _ in range(max(FRAMES)):
        covariance = moves @ covariance @ moves.T + np.diag([way**2, 0.0]) + (1 - kept**2) * np.outer(along, along)
        variances.append(covariance[0, 0])
    return np.asarray([variances[n - 1] / variances[0] for n in FRAMES])


def main() -> None:
    """Print a line for each time."""
    options = arguments(__doc__)
    start_jax()
    names = [*WALKS, OPENSIM][: 1 if options.quick else None]
    ways = np.concatenate([squared_ways(recorded(DATA, name, seed).states) for seed, name in enumerate(names)], 1)
    print("frames  recorded  independent  with velocities")
    for n, found, expected in zip(FRAMES, np.nanmedian(ways, 1), expected_ways(), strict=True):
        print(f"{n:6d}  {found:8.1f}  {n:11d}  {expected:15.1f}")


if __name__ == "__main__":
    main()
