"""Which jobs each part of the reproduction has, and how large they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from poseppl_papers.choo_fleet.contest import (
    CONTESTANTS,
    ContestRuns,
    TrajectoryRuns,
    contest_frame,
    run_trajectory,
    settings_of,
)
from poseppl_papers.choo_fleet.reference_check import ReferenceCheck, check_reference
from poseppl_papers.choo_fleet.sequence import SequenceRuns, Settings, run_sequence
from poseppl_papers.choo_fleet.single_frame import FrameRuns, FrameTiming, estimate_frame, time_frame
from poseppl_papers.choo_fleet.systems import SIMULATED, SYSTEMS, single_frames, stage_of
from poseppl_papers.choo_fleet.tuning import STEP_SIZES, TuningRuns, tune
from poseppl_papers.experiment import Task
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.runs import blocks_of


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Runs of each experiment.
        block: Runs of one job.
        num_settings: How many settings of each row of Table 1.
        reference_chains: Chains of a reference.
        check_runs: Runs of the tempered filter that references are compared with.
        check_particles: Their particles.
        systems: The trackers.
        sequence_systems: Those that are run on sequences.
        other_system: The tracker of tuning and contest.
        num_frames: Number of frames of a sequence.
        particles: Smaller numbers of particles than the paper's on sequences, by tracker; if None the paper's, and
            :data:`OTHER_PARTICLES`.
        num_leapfrogs: Each L of the tuning curves.
        tuning_updates: R of the tuning curves at L = 40; other L get as many gradients.
        tuning_runs: Runs of each of them.
        contestants: Filters in the contest.
        contest_runs: Runs of the contest.
        smoothers: Whole-trajectory smoothers that take part on sequences, with their settings.
    """

    runs: int = 50
    block: int = 10
    num_settings: int = 7
    reference_chains: int = 400
    check_runs: int = 20
    check_particles: int = 4_000
    systems: tuple[str, ...] = tuple(SYSTEMS)
    sequence_systems: tuple[str, ...] = ("lower_body", "full_body")
    other_system: str = "full_body"
    num_frames: int = 25
    particles: Mapping[str, int] | None = None
    num_leapfrogs: tuple[int, ...] = (1, 2, 5, 10, 20, 40, 80)
    tuning_updates: int = 128
    tuning_runs: int = 10
    contestants: tuple[str, ...] = tuple(CONTESTANTS)
    contest_runs: int = 20
    smoothers: tuple[tuple[str, Settings], ...] = (("NUTS on all frames", (("num_draws", 100), ("num_warmup", 100))),)


FULL = Scale()
QUICK = Scale(
    runs=8,
    block=8,
    num_settings=4,
    reference_chains=100,
    check_runs=8,
    check_particles=1_000,
    num_frames=10,
    particles={"lower_body": 5_000, "full_body": 10_000},
    num_leapfrogs=(1, 10, 40),
    tuning_updates=64,
    tuning_runs=3,
    contestants=("HMC, as published", "HMC, dense mass", "assumed density", "auxiliary", "extended Kalman"),
    contest_runs=8,
    smoothers=(),
)

PUBLISHED_PARTICLES = {"lower_body": 23_000, "full_body": 108_000}
"""N on sequences, section 7.4."""
OTHER_PARTICLES = {"lower_body": 37_000, "full_body": 40_000}
"""N whose first frame, timed alone, takes about as long as that of HMC's R = 32; on sequences the tables tell what it took."""
PUBLISHED_UPDATES = 32
"""R on sequences."""


def frames_of(recording: Recording) -> tuple[int, ...]:
    """The three frames of a recording."""
    return single_frames(stage_of(recording, "full_body"))


def _estimates(scale: Scale, recordings: Sequence[Recording], systems: Sequence[str], runs: int) -> Task:
    jobs = [
        FrameRuns(recording, system, frame, block, scale.num_settings, scale.reference_chains)
        for recording in recordings
        for system in systems
        for frame in frames_of(recording)
        for block in blocks_of(runs, scale.block)
    ]
    return Task(estimate_frame, jobs)


def plan_single_frame(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Estimates of single frames, and how long each takes alone (section 7.3)."""
    timings = [FrameTiming(BUILT_IN, system, scale.num_settings, 9) for system in scale.systems]
    return {"frames": _estimates(scale, recordings, scale.systems, scale.runs), "timings": Task(time_frame, timings)}


def plan_reference(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """References of single frames beside another algorithm."""
    jobs = [
        ReferenceCheck(recording, system, frame, scale.check_runs, scale.check_particles, scale.reference_chains)
        for recording in recordings
        for system in scale.systems
        for frame in frames_of(recording)
    ]
    return {"references": Task(check_reference, jobs)}


def plan_sequence(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """The filters of section 7.4 on a sequence."""
    jobs = []
    for system in scale.sequence_systems:
        for method, (filter, settings) in _rivals(scale, system).items():
            jobs += [
                SequenceRuns(recordings[0], system, method, filter, tuple(sorted(settings.items())), scale.num_frames, block)
                for block in blocks_of(scale.runs, scale.block)
            ]
    return {"sequences": Task(run_sequence, jobs)}


def _rivals(scale: Scale, system: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """The filters of section 7.4 with their settings, by name."""
    row = SYSTEMS[system]
    chains: dict[str, Any] = {
        "num_chains": row.num_chains,
        "num_updates": PUBLISHED_UPDATES,
        "num_leapfrog": row.num_leapfrog,
        "num_warmup": 6,
        "step_size": row.step_size,
        "target_acceptance": None,
        "jitter": 0.0,
    }
    numbers = {"particle filter": (scale.particles or PUBLISHED_PARTICLES)[system]}
    if scale.particles is None:
        numbers[f"particle filter, N = {OTHER_PARTICLES[system]:,}"] = OTHER_PARTICLES[system]
    particles = {method: ("particle", {"num_particles": number}) for method, number in numbers.items()}
    return {"HMC filter": ("hmc", chains), **particles}


def plan_tuning(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Step sizes and lengths of trajectories (section 7.5)."""
    jobs = [
        TuningRuns(
            recordings[0],
            scale.other_system,
            number,
            STEP_SIZES,
            max(24, scale.tuning_updates * 40 // number),
            scale.tuning_runs,
        )
        for number in scale.num_leapfrogs
    ]
    return {"tuning": Task(tune, jobs)}


def plan_contest(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """The library's filters, on single frames and on sequences."""
    runs = min(scale.runs, scale.contest_runs)
    one = [
        ContestRuns(recording, scale.other_system, frame, method, *settings_of(method), tuple(range(runs)))
        for recording in recordings
        for frame in frames_of(recording)
        for method in scale.contestants
        if method != "particle filter"
    ]
    many = [
        SequenceRuns(recording, scale.other_system, method, *settings_of(method), scale.num_frames, tuple(range(runs)))
        for recording in (recordings[0], SIMULATED)
        for method in scale.contestants
    ]
    whole = [
        TrajectoryRuns(recording, scale.other_system, method, "trajectory", settings, scale.num_frames, tuple(range(runs)))
        for recording in (recordings[0], SIMULATED)
        for method, settings in scale.smoothers
    ]
    return {
        "frames": _estimates(scale, recordings, [scale.other_system], scale.runs),
        "contest": Task(contest_frame, one),
        "contest sequences": Task(run_sequence, many),
        "contest trajectories": Task(run_trajectory, whole),
    }
