"""Segment lengths measured in places beside the joints: how far are they off, and how far are they said to be?

    POSEPPL_DATA=FOLDER python -m studies.measured_lengths [--draws 20]

Of the people of simulated_keypoints.py, whose markers are beside their joints by the law that the tracker has of it. Printed is
the root mean square error of each length over recordings and draws, in mm, in units of its told deviation, and in units of one
that is the same for all lengths.
"""

from __future__ import annotations

import numpy as np

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.tracking.body_sizes import lengths_per_place, measured_lengths
from poseppl.motion.tracking.lasting_errors import SHIFT, SHIFTS_LAST, mean_deviation
from studies.laboratory_rig import LAYOUT, lasting
from studies.simulated_keypoints import OPENSIM, WALKS, recorded

LENGTHS = (
    *("spine", "shoulder_width", "shoulder_forward", "shoulder_drop", "upper_arm", "forearm"),
    *("hip_width", "hip_forward", "hip_drop", "thigh", "shank"),
)
"""That the detector's points tell."""


def errors_and_deviations(subject: MovingSubject, rng: np.random.Generator, draws: int) -> list[np.ndarray]:
    """Errors of the lengths, what is told of them, and what one deviation for all would tell: (3, lengths), a draw each."""
    body, names = subject.body, subject.body.tree.marker_names
    index = [list(body.lengths).index(name) for name in LENGTHS]
    unseen = [k for k, name in enumerate(names) if name not in markers_of_names(LAYOUTS[LAYOUT])]
    one = mean_deviation(np.full(len(subject.frames), 1 / subject.rate))
    found = []
    for _ in range(draws):
        places = body.places(subject.states) + SHIFT * lasting(
            rng, len(subject.frames), (len(names), 3), SHIFTS_LAST, subject.rate
        )
        places[:, unseen] = np.nan
        lengths = measured_lengths(body, places)
        told = one * np.linalg.norm(lengths_per_place(body, places)[index], axis=1)
        found.append(np.stack([[lengths[name] - body.lengths[name] for name in LENGTHS], told, np.full(len(LENGTHS), one)]))
    return found


def main() -> None:
    """Print the table."""
    options = arguments(__doc__, draws=20)
    start_jax()
    rng = np.random.default_rng(0)
    names = list(enumerate((*WALKS, OPENSIM)))[: 1 if options.quick else None]
    subjects = [recorded(DATA, name, seed) for seed, name in names]
    error, told, one = np.moveaxis(
        [row for each in subjects for row in errors_and_deviations(each, rng, 2 if options.quick else options.draws)], 1, 0
    )
    rows = [np.sqrt(np.mean(np.square(values), 0)) for values in (error, error / told, error / one)]
    columns = ("length", "error, mm", "in told deviations", "in one for all")
    show("Lengths", columns, [(name, *(f"{row[k]:.2f}" for row in rows)) for k, name in enumerate(LENGTHS)])


if __name__ == "__main__":
    main()
