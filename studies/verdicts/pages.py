"""Which parts of which pages are made from tables, and the pages of experiments.

In a page such a part stands between two marks, ``<!-- from tables: NAME -->`` and ``<!-- end -->``. All numbers and verdicts in
it come from studies/tables and from the folders of experiments, through the functions named here. An experiment's folder has
its page, which its own functions make.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from poseppl_papers.catalogue import EXPERIMENTS, find_experiment
from poseppl_papers.experiment import Experiment
from poseppl_papers.page import claims_of
from poseppl_papers.sminchisescu_triggs.spectra import modes_found
from poseppl_papers.tables import Table, read_folder

from studies.verdicts import (
    choo_fleet,
    choosing,
    compile_times,
    default_filter,
    ensembles,
    fast_motion,
    gait,
    independent_answers,
    keypoints,
    learned_prior,
    lessons,
    library_jobs,
    marker_places,
    motion_peers,
    named_points,
    one_camera,
    predictions,
    sampling,
    simulated_keypoints,
    simulated_motion,
    sminchisescu_triggs,
    smoothing,
    summary,
    toolkit_speed,
    walks,
)

Tables = Mapping[str, Table]
Section = Callable[[Tables], str]
ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
FOLDERS = {"": ROOT / "studies" / "tables"} | {f"{name}/": DOCS / name for name in EXPERIMENTS if (DOCS / name).is_dir()}
"""Folders of tables, by the beginning of their names."""
MARKED = re.compile(r"(<!-- from tables: ([\w-]+) -->\n\n)(.*?)(\n\n<!-- end -->)", re.DOTALL)


def experiments() -> list[Experiment]:
    """Those whose tables are committed."""
    return [find_experiment(name) for name in EXPERIMENTS if f"{name}/" in FOLDERS]


def tables_of(experiment: str, tables: Tables) -> dict[str, Table]:
    """The tables of an experiment by their own names."""
    start = f"{experiment}/"
    return {name.removeprefix(start): table for name, table in tables.items() if name.startswith(start)}


def of(experiment: str, section: Section) -> Section:
    """A section of an experiment's tables."""
    return lambda tables: section(tables_of(experiment, tables))


def claims(experiment: str) -> Section:
    """The claims of an experiment."""
    return of(experiment, lambda tables: claims_of(find_experiment(experiment), tables))


SECTIONS: Mapping[str, Mapping[str, Section]] = {
    "validation/filters.md": {
        "choosing": choosing.choosing,
        "frame-samplers": sampling.frame_samplers,
        "ensembles": ensembles.ensembles,
        "modes-found": of("sminchisescu-triggs-2001", modes_found),
    },
    "validation/index.md": {"summary": summary.summary},
    "validation/keypoints.md": {
        "keypoints": keypoints.keypoints,
        "held-out-cameras": keypoints.held_out,
        "feet": keypoints.feet,
        "keypoint-speed": keypoints.speed,
        "one-camera": one_camera.one_camera,
        "simulated-keypoints": simulated_keypoints.recorded,
        "simulated-clocks": simulated_keypoints.clocks,
        "smoother-ranks": simulated_keypoints.ranks,
        "gait": gait.gait,
    },
    "validation/lessons.md": {"lessons": lessons.lessons},
    "validation/libraries.md": {
        "library-level": library_jobs.jobs("level"),
        "library-larger": library_jobs.jobs("linear", "lorenz"),
        "library-many": library_jobs.jobs("gradient", "series"),
        "library-long": library_jobs.jobs("parallel"),
        "library-markov": library_jobs.jobs("markov", "regimes"),
        "library-nile": library_jobs.jobs("nile"),
        "library-particles": library_jobs.jobs("pmmh", "smc2"),
        "motion-peers": motion_peers.motion_peers,
    },
    "validation/models.md": {"independent-answers": independent_answers.independent_answers},
    "validation/motion.md": {
        "default-filter": default_filter.default_filter,
        "random-walks": walks.random_walks,
        "marker-places": marker_places.marker_places,
        "fast-motion": fast_motion.fast_motion,
        "fast-motion-modes": fast_motion.fast_motion_modes,
        "learned-prior": learned_prior.points,
        "learned-prior-silhouettes": learned_prior.silhouettes,
        "simulated-motion": simulated_motion.simulated_motion,
        "simulated-coordinates": simulated_motion.coordinates,
        "simulated-checks": predictions.lost,
    },
    "validation/points.md": {"named-points-fly": named_points.fly, "named-points-board": named_points.board},
    "validation/published.md": {
        "speed-ups": of("choo-fleet-2001", choo_fleet.speed_ups),
        "contest": of("choo-fleet-2001", choo_fleet.contest),
        "covariance-scaled": of("sminchisescu-triggs-2001", sminchisescu_triggs.verdicts),
        **{name: claims(name) for name in ("peursum-2010", "darby-2008", "du-guan-2006")},
    },
    "validation/silhouettes.md": {"bodytrack": claims("bodytrack")},
    "validation/smoothing.md": {
        "smoothing-pays": smoothing.smoothing_pays,
        "trajectory": sampling.trajectory,
        "particle-mgrad": sampling.particle_mgrad,
    },
    "validation/speed.md": {
        "toolkit-speed": toolkit_speed.beside_rivals,
        "compile-times": compile_times.compile_times,
        "first-results": toolkit_speed.first_results,
        "filters": sampling.filters,
    },
    "validation/verdicts.md": {"predictive-checks": predictions.checks},
}


def read_tables() -> dict[str, Table]:
    """All committed tables by name."""
    folders = FOLDERS.items()
    return {f"{start}{name}": kept.table for start, folder in folders for name, kept in read_folder(folder).items()}


def made(text: str, page: str, tables: Tables) -> str:
    """The text of a page with its marked parts made again."""
    return MARKED.sub(lambda found: found[1] + SECTIONS[page][found[2]](tables) + found[4], text)
