"""Single poses: how uncertain they are along each direction without a prior over time (Fig. 3), and modes that a search finds.

The table is made by the study ``studies.modes_found``.
"""

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
from poseppl_papers.experiment import Claim, Jobs, Results, Tables
from poseppl_papers.measured import MATTERS, mean_interval
from poseppl_papers.recordings import BUILT_IN
from poseppl_papers.runs import stacked
from poseppl_papers.sminchisescu_triggs.trackers import PUBLISHED, TRACKERS
from poseppl_papers.sminchisescu_triggs.tracks import Tracks, compiled_model, data_of, in_metres, scene_of
from poseppl_papers.tables import Table, grouped, markdown

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


Rows = list[dict[str, Any]]
_STARTS = (12, 48, 192)
_SCALED, _NOISE = "covariance scaled", ("dynamic noise", "multiple hypotheses")


def modes_found(tables: Tables) -> str:
    """Shares of modes by method and number of starts, and modes an evaluation; empty without the table."""
    if "modes_found" not in tables:
        return ""
    rows = tables["modes_found"].records()
    names = dict.fromkeys(row["method"] for row in rows)
    cells = {name: [_cell(rows, name, count) for count in _STARTS] for name in names}
    (scaled, scaled_name), (noise, noise_name) = _best(rows, _SCALED), max(_best(rows, kind) for kind in _NOISE)
    jumps, prior = (_rate(rows, name) for name in ("kinematic jumps", "draws of the prior"))
    sentence = (
        f"With {_STARTS[-1]} starts the best of scaled covariances ({scaled_name}) finds {scaled:.1f} modes in 1,000 "
        f"evaluations, the best of noise ({noise_name}) {noise:.1f}, kinematic jumps {jumps:.1f}, and draws of the prior "
        f"{prior:.1f}."
    )
    header = ("starts drawn from", *(f"{count} starts" for count in _STARTS))
    return f"{markdown(header, [[name, *cells[name]] for name in names])}\n\n{sentence}"


def modes_claim(tables: Tables) -> Claim:
    """Whether scaled covariances find more modes an evaluation than inflated noise, the best setting of each."""
    rows = tables["modes_found"].records()
    scaled, (noise, noise_name) = _best(rows, _SCALED)[1], max(_best(rows, kind) for kind in _NOISE)
    own, theirs = _rates(rows, scaled), _rates(rows, noise_name)
    more = mean_interval(np.subtract(own, theirs))
    return Claim(
        "Section 6: covariance scaled sampling finds more modes of a pose an evaluation than inflated dynamical noise",
        "significantly more effective",
        f"{np.mean(own):.1f} against {np.mean(theirs):.1f} in 1,000 evaluations, {more.text('.1f')} more, {len(own)} poses",
        more.above(MATTERS * noise),
        f"by more than a tenth; {scaled} against {noise_name}, {_STARTS[-1]} starts; 95 % interval over poses",
    )


def _of(rows: Rows, name: str, count: int) -> Rows:
    return [row for row in rows if row["method"] == name and row["starts"] == count]


def _cell(rows: Rows, name: str, count: int) -> str:
    """Percent of the modes and of their mass, and evaluations; means over poses."""
    mine = _of(rows, name, count)
    shares = [
        sum(100 * row[key] / (row["of"] if key == "modes" else 1) for row in mine) / len(mine) for key in ("modes", "mass")
    ]
    return f"{shares[0]:.0f} %, {shares[1]:.0f} % ({sum(row['evaluations'] for row in mine) / len(mine):,.0f})"


def _best(rows: Rows, kind: str) -> tuple[float, str]:
    """The rate of the best setting of a kind of starts, and its name."""
    names = dict.fromkeys(row["method"] for row in rows)
    return max((_rate(rows, name), name) for name in names if name.startswith(kind))


def _rate(rows: Rows, name: str) -> float:
    """Modes beside the first in 1,000 evaluations, at the most starts; mean over poses."""
    return float(np.mean(_rates(rows, name)))


def _rates(rows: Rows, name: str) -> list[float]:
    """The same of each pose."""
    return [1000 * (row["modes"] - 1) / row["evaluations"] for row in _of(rows, name, _STARTS[-1])]
