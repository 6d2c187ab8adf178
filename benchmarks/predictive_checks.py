"""Do predictive checks, which need no truth, tell the runs whose intervals are too narrow?

    python benchmarks/predictive_checks.py [--quick] [--models lorenz,growth] [--filters NAMES] [--seeds 3] [--frames 100]

Each run is of data that the model itself simulates, with its truth kept aside: Lorenz-96 (40 coordinates, every other seen,
noise 0.1 and 1), the growth model, a linear Gaussian model in 8 dimensions of which 4 are seen, and with `--models walk` the
built-in walk seen by one camera and by two; `--models recordings` tracks some of $POSEPPL_DATA, seen by two. A run is missed
whose 90 % intervals hold less than 80 % of the truth without a verdict of severity "error", and wrongly accused if they hold
more than 87 % with one; verdicts that know the truth do not count.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.growth import growth
from poseppl_models.linear_gaussian import linear_gaussian
from poseppl_models.lorenz96 import lorenz96
from timing import arguments, show

from poseppl.diagnostics import predictive_figures, verdicts
from poseppl.filters.registry import build_filter
from poseppl.motion.tracking import TrackSettings, observe_motion, place_cameras, recorded_subject, track, walking_subject
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.program import CompiledModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.outcome import result_of_run
from poseppl.runs.predictive import Prediction, predictive_checks
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate

FILTERS = ("extended-kalman", "unscented-kalman", "particle", "auxiliary", "tempered", "hmc", "assumed-density")
BODIES = ("extended-kalman", "particle", "tempered", "hmc", "assumed-density")
RECORDINGS = (("cmu_walks/05_01.amc", "05.asf"), ("cmu_walks/07_01.amc", "07.asf"), ("cmu_amc/02_04.amc", "02.asf"))


class Toy(NamedTuple):
    """A model, and whether its inputs are the times of the frames."""

    model: CompiledModel
    times: bool = False


TOYS: Mapping[str, Callable[[], dict[str, Toy]]] = {
    "lorenz": lambda: {f"Lorenz-96, noise {noise:g}": Toy(lorenz96(40, noise).compile()) for noise in (0.1, 1.0)},
    "growth": lambda: {"growth": Toy(growth().compile(1.0), times=True)},
    "linear": lambda: {"linear, d = 8": Toy(linear_gaussian(8, 4).compile())},
}


@cache
def filter_of(name: str, model: CompiledModel) -> tuple[Any, Any, Any]:
    """Filter, collector and checks, the same for all seeds, so that they are compiled once."""
    return build_filter(name, model, {})[0], collect_draws(model, max_draws=20), predictive_checks(model)


def toy_results(which: str, names: list[str], seeds: int, frames: int) -> Iterator[tuple[str, str, int, Any]]:
    """Results of a toy, by model, filter and seed."""
    for title, toy in TOYS[which]().items():
        for name in names:
            filter, collect, predict = filter_of(name, toy.model)
            for seed in range(seeds):
                inputs = jnp.arange(1.0, frames + 1) if toy.times else None
                truth, values = simulate(toy.model, jax.random.key(1000 + seed), frames, inputs)
                observations = toy.model.observe(jax.tree.map(np.asarray, values))
                run = run_filter(filter, jax.random.key(seed), observations, inputs, collect=collect, predict=predict)
                yield title, name, seed, result_of_run(run, toy.model, observations, truth=truth, attrs={"filter": name})


def walk_results(names: list[str], seeds: int, frames: int) -> Iterator[tuple[str, str, int, Any]]:
    """Results of the built-in walk: another noise for each seed."""
    walk = walking_subject(frames=f"0:{frames}")
    for count in (1, 2):
        for name in names:
            for seed in range(seeds):
                scene = observe_motion(
                    walk, place_cameras(walk.markers[:, 0], 0.0, count=count), camera_names(count), seed=seed
                )
                yield f"walk, {count} camera(s)", name, seed, track(scene, TrackSettings(filter=name, seed=seed, max_draws=100))


def recorded_results(names: list[str], seeds: int, frames: int) -> Iterator[tuple[str, str, int, Any]]:
    """Results of recordings, seen by two cameras."""
    folder = Path(os.environ.get("POSEPPL_DATA", "../shared/data"))
    for file, skeleton in RECORDINGS:
        path = folder / file
        subject = recorded_subject(path, path.with_name(skeleton), frames=f"0:{4 * frames}:4")
        for name in names:
            for seed in range(seeds):
                scene = observe_motion(subject, cameras_around(subject, count=2), camera_names(2), seed=seed)
                yield path.stem, name, seed, track(scene, TrackSettings(filter=name, seed=seed, max_draws=100))


def judge(tree: Any) -> tuple[float, Any, list[str]]:
    """Coverage of 90 % intervals of the state, the predictive figures, and the errors found without the truth."""
    blind = tree.copy()
    data = blind["diagnostics"].dataset if "diagnostics" in blind.children else None
    low, high = (tree["summary"].dataset["state_quantile"].sel(quantile=level).values for level in (0.05, 0.95))
    truth = tree["truth"].dataset["state"].values
    free = (tree["summary"].dataset["state_sd"].values > 0).any(axis=0)
    coverage = ((low <= truth) & (truth <= high))[:, free].mean()
    del blind["truth"]
    if data is not None:
        del blind["diagnostics"]
    checks = tree["predictive"].dataset
    figures = predictive_figures(Prediction(*(checks[name].values for name in Prediction._fields)))
    return coverage, figures, [found.text for found in verdicts(blind) if found.severity == "error"]


def main() -> None:
    options = arguments(__doc__, models="lorenz,growth,linear", filters="", seeds=3, frames=100)
    seeds, frames = (1, 12) if options.quick else (options.seeds, options.frames)
    rows, missed, accused = [], 0, 0
    for which in options.models.split(","):
        known = FILTERS if which in TOYS else BODIES
        names = [name for name in options.filters.split(",") if name] or list(known)
        results = {"walk": walk_results, "recordings": recorded_results}
        runs = results[which](names, seeds, frames) if which in results else toy_results(which, names, seeds, frames)
        for title, name, seed, tree in runs:
            coverage, figures, errors = judge(tree)
            predicted = any(text.startswith("The data say") for text in errors)
            fault = "missed" if coverage < 0.8 and not errors else "accused" if coverage > 0.87 and errors else ""
            missed, accused = missed + (fault == "missed"), accused + (fault == "accused")
            shown = " ".join(f"{ratio.estimate:.2f}±{ratio.standard_error:.2f}" for ratio in figures[:3])
            verdict = ("prediction" if predicted else "") + (" other" if len(errors) > predicted else "")
            row = [
                title,
                name,
                str(seed),
                f"{100 * coverage:.0f}",
                shown,
                f"{100 * figures.outer.estimate:.0f}",
                verdict,
                fault,
            ]
            rows.append(row)
            print("\t".join(row), flush=True)
    head = ["model", "filter", "seed", "90 % hold, %", "variance of errors over claimed: joined, squares, products"]
    show("", [*head, "outer 10 % hold, %", "errors found", ""], rows)
    print(f"{len(rows)} runs: {missed} below 80 % missed, {accused} above 87 % wrongly accused")


if __name__ == "__main__":
    main()
