"""Jobs and tables: how uncertain a pose is along each direction, without a prior over time (Fig. 3 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.jobs import Job
from poseppl.motion.geometry import marker_positions, project
from poseppl.report.picture import Picture, new_picture
from poseppl_papers.experiment import Jobs, Results, Tables
from poseppl_papers.recordings import BUILT_IN
from poseppl_papers.runs import stacked
from poseppl_papers.sminchisescu_triggs.trackers import PUBLISHED, TRACKERS
from poseppl_papers.sminchisescu_triggs.tracks import Tracks, compiled_model, data_of, in_metres, scene_of
from poseppl_papers.tables import Table, grouped

BODIES = {"arm": "arm", "stiff_shoulders": "pivot", "full": "turns"}
"""Bodies, and the programs of their motions."""
_SECONDS, _RATE = 0.4, 25.0
COLUMNS = ("body", "coordinates", "pose", "rank", "sd")
_ABOUT = (
    "Standard deviations of a pose along the principal axes of its covariance (metres and radians), the most uncertain first: "
    "the inverse of the curvature of the points' cost at the truth, where it is least, and of the stabilisers. No prior over "
    "time."
)


@dataclass(frozen=True)
class Spectrum(Job):
    """Spectra of poses.

    Attributes:
        kind: The body.
        seeds: Seeds of the poses.
    """

    kind: str
    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """The body."""
        return f"spectrum-{self.kind}"


def spectra(job: Spectrum) -> dict[str, Any]:
    """Standard deviations ``sd`` (poses, d) along the principal axes, the largest first."""
    return stacked([{"sd": _spectrum(job.kind, seed)} for seed in job.seeds])


def _spectrum(kind: str, seed: int) -> Floats:
    tracks = Tracks(BODIES[kind], kind, BUILT_IN, _RATE, _SECONDS, False, PUBLISHED, (seed,))
    scene = scene_of(tracks, seed)
    inputs, model = compiled_model(tracks, TRACKERS[PUBLISHED], scene)
    truth = jnp.asarray(scene.motion.states[-1], float)
    points = project(scene.camera, marker_positions(inputs.tree, truth))
    observation = model.observe(data_of(model, np.asarray(points, np.float64)))
    information = jit(model.observation_information)(truth, observation, inputs)
    units = in_metres(len(information))
    precision = np.asarray(information, np.float64) * np.outer(units, units) + np.diag(scene.motion.body.stabilisers**-2.0)
    sd: Floats = 1 / np.sqrt(np.maximum(np.linalg.eigvalsh(precision), 1e-12))
    return sd


def spectra_table(jobs: Jobs, results: Results) -> list[Table]:
    """A row for each pose and axis."""
    rows = [
        (job.kind, len(sd), seed, rank, float(value))
        for job in jobs["spectra"]
        for seed, sd in zip(job.seeds, results[job.key]["sd"], strict=True)
        for rank, value in enumerate(sd, 1)
    ]
    return [Table("spectra", COLUMNS, rows, _ABOUT)]


def spectra_of(table: Table, kind: str) -> Floats:
    """Standard deviations (poses, d) of a body."""
    poses = grouped(table.records(body=kind), lambda row: row["pose"])
    return np.array([[row["sd"] for row in sorted(own, key=lambda row: int(row["rank"]))] for own in poses.values()])


def log_volume_ratio(sd: Floats) -> Floats:
    """log10 of how much larger the search volume of uniform noise is than that of the scaled covariance (section 1.1).

    Both double the radius along the most uncertain axis: the one adds noise alike to all, the other scales all.

    Args:
        sd: Standard deviations (..., d).
    """
    widest = np.max(sd, -1, keepdims=True)
    ratio: Floats = np.sum(np.log10(np.sqrt(sd**2 + 3 * widest**2) / (2 * sd)), -1)
    return ratio


def draw_spectra(tables: Tables, jobs: Jobs, results: Results) -> dict[str, Picture]:
    """Fig. 3: the spectra."""
    table = tables["spectra"]
    picture = new_picture(6.0, 4.0)
    axis = picture.subplots()
    for number, kind in enumerate(table.values("body")):
        sd = spectra_of(table, kind)
        axis.plot(np.arange(1, sd.shape[1] + 1), sd.T, color=f"C{number}", alpha=0.2, linewidth=0.8)
        label = f"{sd.shape[1]} coordinates"
        axis.plot(
            np.arange(1, sd.shape[1] + 1), np.exp(np.log(sd).mean(0)), "o-", color=f"C{number}", label=label, markersize=3
        )
    axis.set(yscale="log", xlabel="principal axis", ylabel="standard deviation (m, rad)")
    axis.legend()
    return {"spectra.png": picture}


def plan_of(seeds: Sequence[int]) -> list[Spectrum]:
    """A job for each body."""
    return [Spectrum(kind, tuple(seeds)) for kind in BODIES]
