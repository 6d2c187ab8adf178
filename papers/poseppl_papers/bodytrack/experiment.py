"""The experiment: its plan, its parts, the benchmark's own figures and ours, and what its page says of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from poseppl.errors import InputError
from poseppl_papers.bodytrack.frame import (
    FrameEstimates,
    PoseScores,
    estimate_frame,
    estimate_table,
    pose_table,
    score_poses,
)
from poseppl_papers.experiment import Claim, Experiment, Part, Tables, Task, claims_by_table, on_one_recording, verdict_of
from poseppl_papers.images.systems import LIMBS, Method
from poseppl_papers.measured import MATTERS, Interval, Measured, difference, find
from poseppl_papers.recordings import Recording

SCORES = {"initial": -0.3068, "reference": -0.2945}
"""Values of the benchmark's likelihood, to four digits."""


ESTIMATES = {
    "annealed, 5 x 1,000": Measured(-0.2972, 0.0020, 10),
    "annealed, 5 x 4,000": Measured(-0.2971, 0.0022, 10),
}
"""Scores of its own estimates over ten seeds."""


GAIN = MATTERS * (ESTIMATES["annealed, 5 x 4,000"].mean - SCORES["initial"])
"""The smallest difference of scores that matters: a tenth of what the benchmark's own tracker gains on its first pose."""


CROSSED, PLAIN = "annealed, 20 x 250, limbs crossed", "annealed, 20 x 250"


_ROUNDING = 5e-5


def _scores(tables: Tables) -> list[Claim]:
    found = []
    for name, theirs in SCORES.items():
        for row in tables["poses"].records(figure=f"score of the {name} pose"):
            verdict = verdict_of(abs(row["value"] - theirs) <= _ROUNDING)
            ours = f"{row['value']:.4f}"
            found.append(
                Claim(f"Log-likelihood of the {name} pose", f"{theirs}", ours, verdict, "to the digits that they have")
            )
    return found


def _estimates(tables: Tables) -> list[Claim]:
    table, found = tables["estimates"], []
    names = table.values("method")
    for method, theirs in ESTIMATES.items():
        if method in names:
            ours = find(table, "mean", method=method)
            found.append(Claim(f"Score of the estimate, {method}", theirs.text(4), ours.text(4), *_as_good(ours, theirs)))
    if {CROSSED, PLAIN} <= set(names):
        crossed, plain = (find(table, "mean", method=method) for method in (CROSSED, PLAIN))
        gain, error = difference(crossed, plain)
        what = "Children that inherit limbs find better poses with as many evaluations (Deutscher, Davison and Reid 2001)"
        ours_told = f"{crossed.text(4)} against {plain.text(4)}"
        verdict = on_one_recording(Interval.around(gain, 2 * error).above(GAIN))
        why = (
            f"{gain:.4f} +- {error:.4f} more; by more than {GAIN:.4f}, a tenth of the benchmark's own gain, two standard errors"
        )
        found.append(Claim(what, "better", ours_told, verdict, why))
    return found


def _as_good(ours: Measured, theirs: Measured) -> tuple[str, str]:
    """Is ours as good as theirs, or better?"""
    gain, error = difference(ours, theirs)
    verdict = on_one_recording(Interval.around(gain, 2 * error).above(-GAIN))
    return verdict, f"{gain:+.4f} +- {error:.4f}; worse by less than {GAIN:.4f}, two standard errors over runs"


claims = claims_by_table({"poses": [_scores], "estimates": [_estimates]})


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
