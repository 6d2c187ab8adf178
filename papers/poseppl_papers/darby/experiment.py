"""The experiment: its parts, and what its page says of it."""

from __future__ import annotations

from functools import partial

from poseppl_papers.darby.claims import claims, guided_errors, taught, trackers
from poseppl_papers.darby.plan import (
    FULL,
    QUICK,
    plan_guided,
    plan_guided_alone,
    plan_one_camera,
    plan_trackers,
)
from poseppl_papers.experiment import Experiment, Part
from poseppl_papers.images.tables import ERRORS_ARE, drawn_errors, drawn_scenes, tracked

_SETTING = f"""\
Darby, Li and Costen, "Tracking a walking person using activity-guided annealed particle filtering", FG 2008, \
doi:10.1109/AFGR.2008.4813348: the annealed filter that is guided by a learned motion, and the standard one. \
{ERRORS_ARE} The diffusion is half of the walk's largest changes between frames (section 6.2), here \
of the poses closest to the truth; children inherit \
limbs whole from two parents. Where a motion is learned, each run learns it anew from other walks: of the same person (known) \
or of three others (unknown); frames come at 60 Hz, and diffusion and, of a known person, limits are the training data's."""
_DEPARTURES = """\
- The recordings, the room and its four cameras are ours; where nothing is learned the rate is 30 Hz instead of 60.
- Where a motion is learned, two walks of each person are tracked, one at a time; a known person's others are up to \
1,900 frames at 60 Hz, as many as there are.
- The standard filter beside the guided one walks with the diffusion of the three others, and has our limits.
- In a crossover the learned features are one group, and each free joint another: limbs do not lie apart in them.
- The body has the person's segment lengths.
- Half of the largest change is the standard deviation of the noise; the paper has it as a covariance. P_r is estimated \
from pairs of draws of the transition, one pair a particle, so that with 40 particles each variance has a relative \
standard deviation of 22 %; the paper has P itself.
- Edges farther than a few pixels from the foreground are left out. The paper masks no edges.
- Baum-Welch adds 0.01 pseudo-frames of the features' variance to each state's covariance, so that a state of few frames \
has one.
- An unknown person has the limits of our body. The paper has learned limits for a known person, and names none for an \
unknown one."""

EXPERIMENT = Experiment(
    name="darby-2008",
    title="Darby, Li and Costen 2008, run again",
    setting=_SETTING,
    departures=_DEPARTURES,
    full=FULL,
    quick=QUICK,
    parts={
        "trackers": Part(
            "the standard annealed filter with four cameras",
            plan_trackers,
            partial(tracked, "trackers"),
            partial(drawn_errors, "trackers"),
        ),
        "one-camera": Part(
            "the same with one camera, under the standard and the modified weight (section 6.1)",
            plan_one_camera,
            partial(tracked, "one_camera"),
            partial(drawn_errors, "one_camera"),
        ),
        "guided": Part(
            "the guided filter with two cameras, of known and unknown people",
            plan_guided,
            partial(taught, "guided"),
            partial(drawn_scenes, "guided"),
            all_recordings=True,
        ),
        "guided-one-camera": Part(
            "the guided filter with one camera, of known people, under Eq. 9",
            plan_guided_alone,
            partial(taught, "guided_one_camera"),
            partial(drawn_scenes, "guided_one_camera"),
            all_recordings=True,
        ),
    },
    claims=claims,
    sections={"The guided filter": guided_errors, "The annealed filter": trackers},
    pictures={
        "guided.png": "Errors of the guided filter with two cameras",
        "guided_one_camera.png": "Errors of the guided filter with one camera",
        "trackers.png": "Errors with four cameras",
        "one_camera.png": "Errors with one camera",
    },
)
