"""Do predictive checks, which need no truth, find the runs whose intervals are too narrow?

    python -m studies.predictive_checks [--quick] [--models lorenz,growth] [--filters NAMES] [--seeds 3] [--frames 100]
        [--output predictive-checks] [--again]

Each run has data that the model itself simulates, and a truth that the checks do not see: Lorenz-96 (40 coordinates, every
other one seen, noise 0.1 and 1), the growth model, and a linear Gaussian model in 8 dimensions of which 4 are seen. `--models
walk` adds the built-in walk seen by one camera and by two, `--models recordings` those of random_walk.py, `--models simulated`
the sequences of simulated_motion.py, one a seed, of at most 25 frames.

A run counts as missed if its 90 % intervals have less than 80 % coverage without a verdict of severity "error". It counts as
wrongly accused if they have more than 87 % coverage with one. Verdicts that know the truth do not count. Runs in
OUTPUT/predictive_checks.csv are reused. OUTPUT/predictions has the predictions and the verdicts of each run, so that `--again`
judges all of them by the present verdict.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.growth import growth
from poseppl_models.toys.linear_gaussian import linear_gaussian
from poseppl_models.toys.lorenz96 import lorenz96
from poseppl_papers.choo_fleet.sequence import true_states
from poseppl_papers.choo_fleet.systems import SIMULATED, noisy_points, pose_sequence, stage_of
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.diagnostics import check_intervals, check_predictions, check_unreached, check_updates, predictive_figures, verdicts
from poseppl.diagnostics.verdicts.predictive import prediction_of
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, track
from poseppl.motion.tracking.placing import camera_names, place_cameras
from poseppl.motion.tracking.track import result_of_scene, walk_params
from poseppl.program import CompiledModel
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.collectors import collect_draws
from poseppl.runs.outcome import result_of_run
from poseppl.runs.predictive import Prediction, predictive_checks
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate
from studies.kept_runs import read_runs
from studies.random_walk import RECORDINGS, shared_problem, watch

METHODS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "extended-kalman": ("kalman", {}),
    "unscented-kalman": ("kalman", {"linearisation": "unscented"}),
    "auxiliary": ("guided", {"auxiliary": True}),
    **{name: (name, {}) for name in ("particle", "tempered", "hmc", "assumed-density")},
}
"""The filters and their settings, by the names that tables have."""
BODIES = ("extended-kalman", "particle", "tempered", "hmc", "assumed-density")
_COLUMNS = ("model", "filter", "seed", "frames", "coverage", "inflation", "errors")
_KEY = 4
_KINDS = {
    "prediction": "The data say",
    "unreached": "In weakly informed coordinates",
    "update": "The filter's posteriors",
}
"""Beginnings of the errors that `--again` looks for, by kind; all else is "other"."""
_ABOUT = (
    "Share of the truth in 90 % intervals, variance of the states' errors over the claimed one as the data tell it, and the "
    "errors among the verdicts that need no truth: prediction, unreached, update, other, or none."
)
LEAST, MOST = 0.8, 0.87
"""Coverage below which a run ought to have an error, and above which it ought to have none."""
_SHARED: dict[tuple[int, str], tuple[CompiledModel, Any]] = {}
"""Compiled body and collector, by the number of cameras and the filter."""


class Toy(NamedTuple):
    """A model, and whether its inputs are the times of the frames."""

    model: CompiledModel
    times: bool = False


TOYS: Mapping[str, Callable[[], dict[str, Toy]]] = {
    "lorenz": lambda: {f"Lorenz-96, noise {noise:g}": Toy(lorenz96(40, noise).compile()) for noise in (0.1, 1.0)},
    "growth": lambda: {"growth": Toy(growth().compile(1.0), times=True)},
    "linear": lambda: {"linear, d = 8": Toy(linear_gaussian(8, 4).compile())},
}


class Wanted(NamedTuple):
    """A run that may be made."""

    model: str
    filter: str
    seed: int
    make: Callable[[], Any]


@cache
def filter_of(name: str, model: CompiledModel) -> tuple[Any, Any, Any]:
    """Filter, collector and checks, the same for all seeds, so that they are compiled once."""
    filter, settings = METHODS[name]
    built, _ = FILTERS[filter].build(model, settings)
    return built, collect_draws(model, max_draws=20), predictive_checks(model)


def toy_runs(which: str, names: list[str], seeds: int, frames: int) -> Iterator[Wanted]:
    """Runs of a toy's filters on the data of each seed."""
    for title, toy in TOYS[which]().items():
        for name, seed in itertools.product(names, range(seeds)):
            yield Wanted(title, name, seed, partial(toy_result, toy, name, seed, frames))


def toy_result(toy: Toy, name: str, seed: int, frames: int) -> Any:
    """Result of a run on what the toy simulates."""
    filter, collect, predict = filter_of(name, toy.model)
    inputs = jnp.arange(1.0, frames + 1) if toy.times else None
    truth, values = simulate(toy.model, jax.random.key(1000 + seed), frames, inputs)
    observations = toy.model.observe(jax.tree.map(np.asarray, values))
    run = run_filter(filter, jax.random.key(seed), observations, inputs, collect=collect, predict=predict)
    return result_of_run(run, toy.model, observations, truth=truth, attrs={"filter": METHODS[name][0]})


def walk_runs(names: list[str], seeds: int, frames: int) -> Iterator[Wanted]:
    """Runs on the built-in walk: another noise for each seed."""
    walk = walking_subject(frames=f"0:{frames}")
    for count, name, seed in itertools.product((1, 2), names, range(seeds)):
        cameras = place_cameras(walk.markers[:, 0], 0.0, count=count)
        yield Wanted(
            f"built-in walk, {count} camera{'s' * (count > 1)}", name, seed, partial(tracked, walk, cameras, count, name, seed)
        )


def recorded_runs(names: list[str], seeds: int, frames: int) -> Iterator[Wanted]:
    """Runs on recordings, seen by one camera and by two."""
    for cameras, name, recording, seed in itertools.product((1, 2), names, RECORDINGS, range(seeds)):
        title = f"{recording}, {cameras} camera{'s' * (cameras > 1)}"
        yield Wanted(title, name, seed, partial(recorded_result, recording, cameras, name, seed, frames))


def recorded_result(recording: str, cameras: int, name: str, seed: int, frames: int) -> Any:
    """Result of a filter on a recording, its limbs among the inputs, so that all share one program."""
    folder = DATA
    scene = watch(folder, recording, cameras, frames, seed + 1).scenes[seed]
    if (cameras, name) not in _SHARED:
        model = shared_problem(scene, None).model
        _SHARED[cameras, name] = model, shared_problem(scene, model).collector(20)
    model, collect = _SHARED[cameras, name]
    problem, (filter, _, predict) = shared_problem(scene, model), filter_of(name, model)
    key, count = jax.random.key(seed), len(scene.frames)
    run = run_filter(filter, key, problem.observations, problem.inputs, num_frames=count, collect=collect, predict=predict)
    return result_of_scene(
        scene, problem, run, {"filter": METHODS[name][0], "settings": walk_params(scene.body, TrackSettings())}
    )


def simulated_runs(names: list[str], seeds: int, frames: int) -> Iterator[Wanted]:
    """Runs on motion of the body that the model itself draws, another sequence for each seed."""
    for name, seed in itertools.product(names, range(seeds)):
        yield Wanted("simulated motion", name, seed, partial(simulated_result, name, seed, min(frames, 25)))


def simulated_result(name: str, seed: int, frames: int) -> Any:
    """Result of a filter on a sequence of the contest of Choo and Fleet."""
    stage, shown = stage_of(SIMULATED, "full_body", seed), slice(1, 1 + frames)
    problem = pose_sequence(stage, shown, noisy_points(stage, shown, seed))
    filter, collect, predict = filter_of(name, problem.model)
    data, inputs = problem.observations, problem.inputs
    run = run_filter(filter, jax.random.key(seed), data, inputs, num_frames=frames, collect=collect, predict=predict)
    truth = true_states(stage, shown)
    return result_of_run(run, problem.model, data, truth=truth, attrs={"filter": METHODS[name][0]})


def tracked(subject: Any, cameras: Any, count: int, name: str, seed: int) -> Any:
    """Result of a filter on what the cameras see of a subject."""
    scene = observe_motion(subject, cameras, camera_names(count), seed=seed)
    return track(scene, TrackSettings(filter=METHODS[name][0], options=METHODS[name][1], seed=seed, max_draws=100)).result


class Judged(NamedTuple):
    """Coverage of 90 % intervals of the state, what the data say of it, and the errors found without the truth."""

    coverage: float
    inflation: float
    errors: list[str]


def kinds(errors: Sequence[str]) -> str:
    """Kinds of errors."""
    found = {next((kind for kind, start in _KINDS.items() if error.startswith(start)), "other") for error in errors}
    return " ".join(kind for kind in (*_KINDS, "other") if kind in found) or "none"


def judge(tree: Any) -> Judged:
    """Compare with the truth, and judge without it."""
    blind = tree.copy()
    low, high = (tree["summary"].dataset["state_quantile"].sel(quantile=level).values for level in (0.05, 0.95))
    truth = tree["truth"].dataset["state"].values
    free = (tree["summary"].dataset["state_sd"].values > 0).any(axis=0)
    coverage = ((low <= truth) & (truth <= high))[:, free].mean()
    for known in {"truth", "diagnostics"} & set(blind.children):
        del blind[known]
    figures = predictive_figures(checks_of(tree).data)
    return Judged(coverage, figures.inflation.estimate, [found.text for found in verdicts(blind) if found.severity == "error"])


def checks_of(tree: Any) -> Prediction:
    """The predictive checks of a result, which has them."""
    checks = prediction_of(tree)
    assert checks is not None
    return checks


def keep(folder: Path, key: tuple[str, ...], tree: Any, judged: Judged) -> None:
    """Keep what was predicted, so that another verdict can be tried without another run."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.asarray(value, np.float32) for name, value in checks_of(tree).by_name().items()}
    mean, spread = (tree["summary"].dataset[f"state_{name}"].values for name in ("mean", "sd"))
    state = {"state_mean": mean, "state_sd": spread, "truth": tree["truth"].dataset["state"].values}
    state["ess"] = tree["sample_stats"].dataset["ess"].values
    bounds = tree["summary"].dataset["state_quantile"]
    state |= {name: bounds.sel(quantile=level).values for name, level in (("low", 0.05), ("high", 0.95))}
    np.savez_compressed(folder / file_of(key), **arrays, **state, errors=np.array(judged.errors, str))


def file_of(key: tuple[str, ...]) -> str:
    """Name of the file that keeps a run."""
    return re.sub(r"[^\w.]+", "_", "-".join(key)) + ".npz"


def judged_again(folder: Path, row: tuple[str, ...]) -> tuple[str, ...]:
    """The row of a kept run by the present verdict of its predictions, and the other errors as they were."""
    with np.load(folder / file_of(row[:_KEY])) as kept:
        prediction = Prediction.of(kept)
        posterior = tuple(kept[name] for name in ("state_mean", "state_sd", "ess"))
        names = [f"coordinate {i}" for i in range(kept["state_mean"].shape[1])]
        data, state = prediction
        found = [*check_predictions(data), *(check_unreached(state, *posterior, names) if state is not None else [])]
        if state is not None and state.memory is not None:
            found += check_updates(state, *posterior) or check_intervals(state, kept["low"], kept["high"])
        others = [text for text in kept["errors"].tolist() if kinds([text]) == "other"]
    errors = [each.text for each in found if each.severity == "error"]
    inflation = predictive_figures(data).inflation.estimate
    return (*row[:_KEY], row[_KEY], f"{inflation:.4g}", kinds([*errors, *others]))


def fault(coverage: float, found: str) -> str:
    """Whether a run is missed or wrongly accused."""
    return "missed" if coverage < LEAST and found == "none" else "accused" if coverage > MOST and found != "none" else ""


def main() -> None:
    options = arguments(
        __doc__, models="lorenz,growth,linear", filters="", seeds=3, frames=100, output="predictive-checks", again=False
    )
    start_jax()
    output = options.output
    seeds, frames = (1, 12) if options.quick else (options.seeds, options.frames)
    table = Table("predictive_checks", _COLUMNS, read_runs(output / "predictive_checks.csv"), _ABOUT)
    if options.again:
        table.rows[:] = [judged_again(output / "predictions", row) for row in table.rows]
        write_csv(table, output)
    for which in options.models.split(",") if not options.again else ():
        known = METHODS if which in TOYS else BODIES
        names = [name for name in options.filters.split(",") if name] or list(known)
        known_runs = {"walk": walk_runs, "recordings": recorded_runs, "simulated": simulated_runs}
        runs = known_runs.get(which, partial(toy_runs, which))
        for wanted in runs(names, seeds, frames):
            key = (wanted.model, wanted.filter, str(wanted.seed), str(frames))
            if key in {row[:_KEY] for row in table.rows}:
                continue
            tree = wanted.make()
            judged = judge(tree)
            keep(output / "predictions", key, tree, judged)
            table.rows.append((*key, f"{judged.coverage:.4g}", f"{judged.inflation:.4g}", kinds(judged.errors)))
            write_csv(table, output)
            print(*table.rows[-1], fault(judged.coverage, table.rows[-1][-1]), sep="\t", flush=True)
    faults = [fault(float(row[4]), row[6]) for row in table.rows]
    show("", [*_COLUMNS, ""], [[*row, found] for row, found in zip(table.rows, faults, strict=True)])
    missed, accused = (faults.count(name) for name in ("missed", "accused"))
    print(f"{len(faults)} runs: {missed} below 80 % missed, {accused} above 87 % wrongly accused")


if __name__ == "__main__":
    main()
