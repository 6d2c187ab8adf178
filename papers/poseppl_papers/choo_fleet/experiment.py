"""The experiment: its parts, and what its page says of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from poseppl.motion.geometry import project
from poseppl_papers.choo_fleet.claims import Goal, claims, goals
from poseppl_papers.choo_fleet.contest import contest_table
from poseppl_papers.choo_fleet.figures import (
    draw_contest,
    draw_coordinates,
    draw_poses,
    draw_sequence,
    draw_tuning,
    draw_variances,
)
from poseppl_papers.choo_fleet.frame_tables import frame_tables
from poseppl_papers.choo_fleet.plan import (
    FULL,
    QUICK,
    plan_contest,
    plan_reference,
    plan_sequence,
    plan_single_frame,
    plan_tuning,
)
from poseppl_papers.choo_fleet.reference_check import reference_table, references_agree
from poseppl_papers.choo_fleet.sequence import SequenceRuns, performance, sequence_tables
from poseppl_papers.choo_fleet.systems import noisy_points, stage_of
from poseppl_papers.choo_fleet.tuning import tuning_tables
from poseppl_papers.experiment import Experiment, Jobs, Part, Pictures, Results, Tables
from poseppl_papers.tables import Table, markdown

_FRAME = 10
"""The frame of Fig. 6."""
_SETTING = (
    "One camera at 5 m, noise 0.003, random walk of 15 mm and 0.15 rad a frame at 30 frames a second. A gradient counts as one "
    "evaluation. Each process has one core to itself, unless a table says that the machine was busy."
)
_DEPARTURES = """\
- Resampling is systematic; the paper draws with replacement (multinomial).
- An estimate takes R - 6 draws of each chain; the paper, whose chains hold R + 1 samples with the first one, R - 5.
- Step sizes are ours (0.7, 0.3 and 0.25 for 4, 10 and 28 dimensions against 10.3, 4.0 and 3.0): the paper does not tell the \
curvature that its own multiply (Eq. 17), and with our Gauss-Newton curvature none above 2 is stable.
- All references are long HMC runs; the paper's are, for 4 and 10 dimensions, particle filters. A tempered particle filter \
checks them.
- Recordings and frame rate are ours; the paper does not tell its rate."""


def _contest_tables(jobs: Jobs, results: Results) -> list[Table]:
    sequences = [*jobs["contest sequences"], *jobs["contest trajectories"]]
    return [contest_table(jobs["contest"], jobs["frames"], results), performance("contest_sequences", sequences, results)]


def _draw_sequence(tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    poses = _poses(jobs, results)
    return {"sequence.png": draw_sequence(tables)} | ({"poses.png": draw_poses(poses)} if poses else {})


def _poses(all_jobs: Jobs, results: Results) -> dict[str, Any]:
    """Mean poses of six runs of the paper's two filters on the full body."""
    known = [job for job in all_jobs["sequences"] if isinstance(job, SequenceRuns) and job.system == "full_body"]
    jobs = [job for job in known if job.method in ("HMC filter", "particle filter")]
    if not jobs:
        return {}
    frame = min(_FRAME, jobs[0].num_frames - 1)
    stage = stage_of(jobs[0].recording, "full_body")
    names, here = list(stage.body.tree.marker_names), slice(1 + frame, 2 + frame)
    poses: dict[str, Any] = {"edges": [[names.index(end) for end in edge] for edge in stage.body.edges]}
    for job in jobs:
        if job.method not in poses:
            mean = np.asarray(results[job.key]["markers"])[:6, frame]
            poses[job.method] = {
                "truth": np.repeat(stage.markers[here], len(mean), 0),
                "mean": mean,
                "observed": [noisy_points(stage, here, run)[0, 0] for run in job.runs[: len(mean)]],
                "image": project(stage.cameras, jnp.asarray(mean))[0],
            }
    return poses


def _goals(tables: Tables) -> str:
    return markdown(Goal._fields, goals(tables))


PARTS: Mapping[str, Part] = {
    "single-frame": Part(
        "variance against time, volumes",
        plan_single_frame,
        lambda jobs, results: frame_tables(jobs["frames"], jobs["timings"], results),
        lambda tables, jobs, results: {"coordinates.png": draw_coordinates(tables), "variances.png": draw_variances(tables)},
        all_recordings=True,
    ),
    "reference": Part(
        "references beside another algorithm",
        plan_reference,
        lambda jobs, results: [reference_table(jobs["references"], results)],
        runs=lambda scale: int(scale.check_runs),
        all_recordings=True,
    ),
    "sequence": Part(
        "both filters over 25 frames",
        plan_sequence,
        lambda jobs, results: sequence_tables(jobs["sequences"], results),
        _draw_sequence,
    ),
    "tuning": Part(
        "step sizes and lengths of trajectories",
        plan_tuning,
        lambda jobs, results: tuning_tables(jobs["tuning"], results),
        lambda tables, jobs, results: {"tuning.png": draw_tuning(tables)},
        runs=lambda scale: int(scale.tuning_runs),
    ),
    "contest": Part(
        "the library's filters against the published ones",
        plan_contest,
        _contest_tables,
        lambda tables, jobs, results: {"contest.png": draw_contest(tables)},
        runs=lambda scale: int(min(scale.runs, scale.contest_runs)),
        all_recordings=True,
    ),
}

EXPERIMENT = Experiment(
    name="choo-fleet-2001",
    title="Choo and Fleet 2001, run again",
    setting=_SETTING,
    departures=_DEPARTURES,
    full=FULL,
    quick=QUICK,
    parts=PARTS,
    claims=claims,
    sections={"Are the references right?": references_agree, "Goals": _goals},
    pictures={
        "coordinates.png": "Variances of single variables against time (Fig. 2)",
        "variances.png": "Variance against time and evaluations (Fig. 3)",
        "sequence.png": "Both filters over time (Figs. 4 and 5)",
        "poses.png": "Mean poses at frame 10 (Fig. 6)",
        "tuning.png": "Tuning (section 7.5)",
        "contest.png": "The contest",
    },
    shown=("speed_ups", "volumes", "references", "reference_check", "sequence_summary", "contest", "contest_sequences"),
)
