"""Which filter for which model: every filter on models of the kind that people bring, for docs/validation/filters.md.

    python -m studies.choosing [--quick] [--models NAMES] [--filters NAMES] [--seeds 3] [--frames 60] [--again]
        [--output choosing]

Each seed simulates data from each model (choosing_models.py); the body is the built-in walk seen by one camera. Filters run at
their defaults, or with the settings in their name. The table has the root mean square error of the means (for the body the mean
error of the joints, mm) and the coverage of 90 % intervals of real coordinates. It also has the seconds of a run without
compilation, and errors found by verdicts that need no truth. A filter that refuses a model gives its reason. Runs in
OUTPUT/runs are reused; --again makes none. Separate NAMES by semicolons.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import numpy as np
import xarray as xr
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.diagnostics import diagnose
from poseppl.errors import PosepplError
from poseppl.jobs import Inline, Job, run_jobs
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, track
from poseppl.motion.tracking.placing import camera_names, place_cameras
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.collectors import collect_draws
from poseppl.runs.outcome import result_of_run
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.results import provenance
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate
from studies.choosing_models import MODELS, Tried
from studies.predictive_checks import LEAST, MOST, judge, kinds

BODY = "body, one camera, d = 28"
VARIANTS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "kalman, unscented": ("kalman", {"linearisation": "unscented"}),
    "kalman, 4 iterations": ("kalman", {"num_iterations": 4}),
    "guided, auxiliary": ("guided", {"auxiliary": True}),
    "tempered, random walk": ("tempered", {"kernel": "random-walk"}),
}
"""Filters and settings other than the defaults."""
FIRST = ("particle", "guided, auxiliary", "kalman", "kalman, unscented", "hidden-markov", "rao-blackwellised", "switching")
"""Tried before the others, which take longer to compile."""


@dataclass(frozen=True)
class Trial(Job):
    """A filter on a model's data."""

    model: str
    filter: str
    seed: int
    frames: int

    @property
    def name(self) -> str:
        """Model, filter and seed."""
        return f"{self.model}-{self.filter}-{self.seed}"


def try_filter(trial: Trial) -> dict[str, Any]:
    """Figures of a trial, or why there are none."""
    try:
        tree = tracked(trial) if trial.model == BODY else filtered(trial)
    except (PosepplError, ValueError) as error:
        return {"refused": np.array(str(error))}
    judged = judge(tree)
    return {
        "error": np.array(error_of(tree)),
        "coverage": np.array(coverage_of(tree)),
        "seconds": np.array(float(provenance(tree)["wall_seconds"])),
        "found": np.array(kinds(judged.errors)),
        "texts": np.array(judged.errors, str),
        "inflation": np.array(judged.inflation),
    }


@cache
def tried(name: str) -> Tried:
    """A model, once."""
    return MODELS[name]()


@cache
def built(model: str, name: str) -> tuple[Any, Any, Any]:
    """Filter, collector and checks of a model, once for all seeds."""
    filter, settings = VARIANTS.get(name, (name, {}))
    compiled = tried(model).model
    return FILTERS[filter].build(compiled, settings)[0], collect_draws(compiled, max_draws=20), predictive_checks(compiled)


def filtered(trial: Trial) -> xr.DataTree:
    """Result of a filter on what the model simulates."""
    model, inputs = tried(trial.model).model, tried(trial.model).inputs(trial.frames)
    filter, collect, predict = built(trial.model, trial.filter)
    truth, values = simulate(model, jax.random.key(1000 + trial.seed), trial.frames, inputs)
    observations = model.observe(jax.tree.map(np.asarray, values))
    run = run_filter(filter, jax.random.key(trial.seed), observations, inputs, collect=collect, predict=predict)
    return result_of_run(run, model, observations, truth=truth)


def tracked(trial: Trial) -> xr.DataTree:
    """Result of a filter on what a camera sees of the built-in walk."""
    walk = walking_subject(frames=f"0:{trial.frames}")
    scene = observe_motion(walk, place_cameras(walk.markers[:, 0], 0.0, count=1), camera_names(1), seed=trial.seed)
    filter, settings = VARIANTS.get(trial.filter, (trial.filter, {}))
    return diagnose(track(scene, TrackSettings(filter=filter, options=settings, seed=trial.seed, max_draws=100)).result)


def error_of(tree: xr.DataTree) -> float:
    """Root mean square error of the means; of a body the mean error of its joints, mm."""
    if "diagnostics" in tree.children and "joint_error" in tree["diagnostics"].dataset:
        return float(tree["diagnostics/joint_error"].mean())
    return float(np.sqrt(np.mean((tree["summary/state_mean"].values - tree["truth/state"].values) ** 2)))


def coverage_of(tree: xr.DataTree) -> float:
    """Share of the true real coordinates in 90 % intervals; NaN where there are none."""
    truth = tree["truth/state"].values
    low, high = (tree["summary/state_quantile"].sel(quantile=level).values for level in (0.05, 0.95))
    real = (tree["summary/state_sd"].values > 0).any(0) & ~(truth == np.round(truth)).all(0)
    return float(((low <= truth) & (truth <= high))[:, real].mean()) if real.any() else float("nan")


_COLUMNS = (
    *("model", "filter", "seeds", "error", "coverage", "coverage_se", "seconds", "red", "below", "missed", "above", "accused"),
    *("found", "refused"),
)
_ABOUT = (
    "Means over seeds of the error of means and of the share of true real coordinates in 90 % intervals, with its standard "
    "error; the median of a run's seconds; runs in which verdicts that need no truth find an error; runs that hold less than "
    "80 %, and of these those without an error; runs that hold more than 87 %, and of these those with one; of which kinds "
    "errors are; or why a filter refuses a model."
)


def rows_of(trials: list[Trial], found: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """A row for each model and filter."""
    rows: list[tuple[Any, ...]] = []
    for model, filter in dict.fromkeys((trial.model, trial.filter) for trial in trials):
        runs = [found[trial.key] for trial in trials if (trial.model, trial.filter) == (model, filter)]
        refused = next((str(run["refused"]) for run in runs if "refused" in run), "")
        rows.append((model, filter, len(runs), *([""] * 10 if refused else figures_of(runs)), refused))
    return rows


def figures_of(runs: list[Mapping[str, Any]]) -> list[Any]:
    """The columns from the error to the kinds of errors found."""
    error, coverage, seconds = (np.array([float(run[name]) for run in runs]) for name in ("error", "coverage", "seconds"))
    findings = [str(run["found"]) for run in runs]
    red, below, above = np.array([each != "none" for each in findings]), coverage < LEAST, coverage > MOST
    spread = float(coverage.std(ddof=1) / np.sqrt(len(runs))) if len(runs) > 1 else float("nan")
    counts = [int(chosen.sum()) for chosen in (red, below, below & ~red, above, above & red)]
    kinds_found = dict.fromkeys(word for each in findings if each != "none" for word in each.split())
    return [float(error.mean()), float(coverage.mean()), spread, float(np.median(seconds)), *counts, " ".join(kinds_found)]


def main() -> None:
    options = arguments(__doc__, models="", filters="", seeds=3, frames=60, again=False, output="choosing")
    start_jax()
    output = options.output
    seeds, frames = (1, 5) if options.quick else (options.seeds, options.frames)
    filters = [name for name in options.filters.split(";") if name] or list(dict.fromkeys([*FIRST, *FILTERS, *VARIANTS]))
    models = [name for name in options.models.split(";") if name] or [*MODELS, BODY]
    table = Table("choosing", _COLUMNS, [], _ABOUT)
    for model in models:
        trials = [Trial(model, name, seed, frames) for name in filters for seed in range(seeds)]
        if options.again:
            trials = [trial for trial in trials if (output / "runs" / f"{trial.key}.npz").is_file()]
        found = run_jobs(try_filter, trials, output / "runs", executor=Inline())
        table.rows.extend(rows_of(trials, found))
        write_csv(table, output)
        rows = [row[1:] for row in table.rows if row[0] == model]
        shown = [[value[:60] if isinstance(value, str) else f"{value:.3g}" for value in row] for row in rows]
        show(model, list(_COLUMNS[1:]), shown)
        jax.clear_caches()


if __name__ == "__main__":
    main()
