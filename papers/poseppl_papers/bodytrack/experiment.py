"""The experiment: its plan, its parts, and what its page says of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from poseppl.errors import InputError
from poseppl_papers.bodytrack.claims import CROSSED, ESTIMATES, PLAIN, claims
from poseppl_papers.bodytrack.frame import (
    FrameEstimates,
    PoseScores,
    estimate_frame,
    estimate_table,
    pose_table,
    score_poses,
)
from poseppl_papers.experiment import Experiment, Part, Task
from poseppl_papers.images.systems import LIMBS, Method
from poseppl_papers.recordings import Recording

_SETTING = """\
The likelihood and the tracker of Deutscher and Reid (2005, doi:10.1023/B:VISI.0000043757.18370.9c), as the PARSEC benchmark \
bodytrack has them, on its first frame: four cameras, 31 coordinates. A score is the likelihood's logarithm from every sample, \
which has no noise of its own: annealing gives it a width."""
_DEPARTURES = """\
- One frame is at hand.
- Particles whose limbs meet are not dropped. Exponents are those of the annealed filter here, which asks for the survival of \
half of the particles in each layer, as the benchmark does."""


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Runs of each filter.
        num_poses: Poses on which few samples are held against all.
        methods: Which filters.
    """

    runs: int = 10
    num_poses: int = 2000
    methods: tuple[str, ...] = (*ESTIMATES, "annealed, 1 x 1,000", CROSSED, PLAIN)


def method_of(name: str) -> Method:
    """The filter of a name, "annealed, LAYERS x PARTICLES", and what is said of its limbs."""
    layers, count = (int(word.replace(",", "")) for word in name.removeprefix("annealed, ").split(", limbs")[0].split(" x "))
    settings: dict[str, object] = {"num_layers": layers, "num_particles": count}
    return Method(name, "annealed", tuple(sorted((settings | ({"crossover": LIMBS} if name == CROSSED else {})).items())))


def _benchmark(recordings: Sequence[Recording]) -> Recording:
    if recordings[0].path is None:
        expected = "--motion sequenceB_1=FOLDER, the folder of the PARSEC benchmark's test data"
        raise InputError("the built-in walk is no recording of bodytrack", field="--motion", expected=expected)
    return recordings[0]


def plan_likelihood(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Scores of known poses."""
    return {"poses": Task(score_poses, [PoseScores(_benchmark(recordings), scale.num_poses)])}


def plan_estimates(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Results of the filters."""
    recording, runs = _benchmark(recordings), tuple(range(scale.runs))
    jobs = [FrameEstimates(recording, method_of(name), runs) for name in scale.methods]
    return {"estimates": Task(estimate_frame, jobs)}


EXPERIMENT = Experiment(
    name="bodytrack",
    title="The bodytrack benchmark, run again",
    setting=_SETTING,
    departures=_DEPARTURES,
    full=Scale(),
    quick=Scale(runs=3, num_poses=200, methods=("annealed, 5 x 1,000",)),
    parts={
        "likelihood": Part(
            "scores of known poses, and few samples for all",
            plan_likelihood,
            pose_table,
            runs=lambda scale: 1,
        ),
        "estimates": Part(
            "what annealed filters find in the first frame",
            plan_estimates,
            estimate_table,
        ),
    },
    claims=claims,
    shown=("poses", "estimates"),
)
