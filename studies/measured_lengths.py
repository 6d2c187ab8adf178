"""Segment lengths measured in places beside the joints: how far are they off, and how far are they said to be?

    POSEPPL_DATA=FOLDER python -m studies.measured_lengths [--draws 20]

People are those of simulated_keypoints.py, whose markers are beside their joints with the tracker's own distribution. The table
has the root mean square error of each length over recordings and draws, in mm. It also has it in units of the reported standard
deviation, and of one that is the same for all lengths.
"""

from __future__ import annotations

import numpy as np

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.drawn_detections import LAYOUT, lasting
from poseppl.motion.tracking.body_sizes import lengths_per_place, measured_lengths
from poseppl.motion.tracking.lasting_errors import SHIFT, SHIFTS_LAST, mean_deviation
from studies.simulated_keypoints import OPENSIM, WALKS, recorded

LENGTHS = (
    *("spine", "shoulder_width", "shoulder_forward", "shoulder_drop", "upper_arm", "forearm"),
    *("hip_width", "hip_forward", "hip_drop", "thigh", "shank"),
)
"""Lengths that the detector's points determine."""


def errors_and_deviations(subject: MovingSubject, rng: np.random.Generator, draws: int) -> list[np.ndarray]:
    """Errors of the lengths, in mm, in reported standard deviations and in one for all lengths: (3, lengths), a draw each."""
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
        claimed = one * np.linalg.norm(lengths_per_place(body, places)[index], axis=1)
        found.append(np.stack([[lengths[name] - body.lengths[name] for name in LENGTHS], claimed, np.full(len(LENGTHS), one)]))
    return found


def main() -> None:
    """Print the table."""
    options = arguments(__doc__, draws=20)
    start_jax()
    rng = np.random.default_rng(0)
    names = list(enumerate((*WALKS, OPENSIM)))[: 1 if options.quick else None]
    subjects = [recorded(DATA, name, seed) for seed, name in names]
    error, claimed, one = np.moveaxis(
        [row for each in subjects for row in errors_and_deviations(each, rng, 2 if options.quick else options.draws)], 1, 0
    )
    rows = [np.sqrt(np.mean(np.square(values), 0)) for values in (error, error / claimed, error / one)]
    columns = ("length", "error, mm", "in told deviations", "in one for all")
    show("Lengths", columns, [(name, *(f"{row[k]:.2f}" for row in rows)) for k, name in enumerate(LENGTHS)])


if __name__ == "__main__":
    main()
