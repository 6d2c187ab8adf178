"""Cost and gain of compiling each loop over few bytes into one function of XLA.

    python -m benchmarks.small_loops [--quick] [--turns 3] [--frames 100] [--only particle]

On a CPU each operation of a loop is a task of its own, except in loops over less than 1,024 bytes. The command line asks for
one function up to `poseppl.small_loops.SMALL` bytes. An algorithm runs in a process of its own, without a compile cache, with
and without this in turns. The model is the growth model or the 28-DOF body in one camera (a third of the frames); smoothers get
the filter's draws. Seconds are of the processor: the difference between a first `infer` or `smooth` and the fastest of three
later ones, and the fastest. Each is the minimum over turns, since other work on the machine only adds. The last column is the
largest difference of means, in standard deviations.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any, cast

import jax
import numpy as np
from poseppl_models.toys.growth import growth

from benchmarks.simulated import build_problem
from benchmarks.timing import arguments, show, without_compile_cache
from poseppl import small_loops
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from poseppl.runs.infer import infer, smooth
from poseppl.runs.run import Constant
from poseppl.runs.simulation import simulate

CASES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    *(("growth", "particle", {"num_particles": number}) for number in (1000, 10_000, 100_000)),
    ("growth", "kalman", {}),
    ("growth", "tempered", {}),
    ("growth", "hmc", {}),
    ("growth", "forward-backward", {}),
    ("growth", "backward-simulation", {}),
    ("growth", "viterbi", {}),
    ("growth", "particle-gibbs", {}),
    ("body", "kalman", {}),
    ("body", "assumed-density", {}),
    ("body", "hmc", {}),
    ("body", "tempered", {}),
    ("body", "particle", {"num_particles": 10_000}),
    ("body", "particle", {"num_particles": 100_000}),
)


def prepared(of: str, name: str, settings: dict[str, Any], frames: int) -> Callable[[], Any]:
    """A function that runs an algorithm and returns its result."""
    if of == "body":
        frames //= 3
        problem = build_problem()
        model, inputs = problem.model, cast(Any, Constant(problem.inputs))
        rows = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (frames, *np.shape(leaf))), problem.inputs)
    else:
        model = growth().compile(1.0)
        rows = inputs = np.arange(1.0, frames + 1, dtype=np.float32)
    data, key = model.observe(simulate(model, jax.random.key(0), frames, rows)[1]), jax.random.key(1)
    if name in set(FILTERS):
        return partial(infer, model, data, FILTERS[name].build(model, settings)[0], key, inputs)
    filtered = infer(model, data, FILTERS["particle"].build(model, {"num_particles": 1000})[0], key, inputs)
    return partial(smooth, filtered, SMOOTHERS[name].build(model, settings)[0], key, inputs)


def measure(case: tuple[str, str, dict[str, Any]], frames: int) -> tuple[float, float, Any, Any]:
    """Processor seconds of compilation and of a run; means and standard deviations."""
    without_compile_cache()
    run, seconds = prepared(*case, frames), []
    for _ in range(4):
        started = time.process_time()
        tree = run()
        seconds.append(time.process_time() - started)
    fastest, found = min(seconds[1:]), tree["summary"].dataset
    return seconds[0] - fastest, fastest, found["state_mean"].values, found["state_sd"].values


def in_turns(case: tuple[str, str, dict[str, Any]], frames: int, turns: int) -> list[str]:
    """Compilation and run without and with one function for each, in new processes; the difference of means."""
    given = os.environ.get("XLA_FLAGS", "")
    found: dict[str, list[Any]] = {given: [], small_loops.as_functions({"XLA_FLAGS": given})["XLA_FLAGS"]: []}
    for flags in turns * list(found):
        os.environ["XLA_FLAGS"] = flags
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            found[flags].append(pool.submit(measure, case, frames).result())
    os.environ["XLA_FLAGS"] = given
    (*_, mean, spread), (*_, other, _) = (runs[0] for runs in found.values())
    apart = float(np.max(np.abs(mean - other) / np.maximum(spread, 1e-12)))
    return [*(f"{min(run[kind] for run in runs):.3g}" for kind in (0, 1) for runs in found.values()), f"{apart:.1g}"]


def main() -> None:
    options = arguments(__doc__, frames=100, turns=3, only="")
    frames, turns = (6, 1) if options.quick else (options.frames, options.turns)
    rows = []
    for case in CASES:
        if options.only not in ("", case[1]):
            continue
        of, name, settings = case
        listed = ", ".join(f"{setting} = {value:,}" for setting, value in settings.items())
        rows.append([of, f"{name} {listed}".strip(), *in_turns(case, frames, turns)])
        print(*rows[-1], sep="\t", flush=True)
    columns = ["", "", "compilation without", "with", "run without", "with", "apart"]
    show(f"Processor seconds, {frames} frames", columns, rows)


if __name__ == "__main__":
    main()
