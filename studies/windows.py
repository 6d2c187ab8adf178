"""Does a window pay? The moving-window filter beside those with no window, on the 28-DOF body seen by one camera.

    python -m studies.windows [--quick] [--simulated] [--frames 30] [--sequences 4] [--longest 5]

The body walks the built-in gait, seen at 5 m with fresh noise in each sequence; with --simulated each sequence is drawn from
the model itself, whose posterior ought to cover the truth as its levels say. The error is the mean distance of the posterior
means of the 17 markers from the truth; coverage is that of their coordinates. A frame's time leaves compilation out: first that
of all threads of the process, which a busy machine does not stretch, then that of the clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.simulated import build_problem, draw_sequence
from benchmarks.timing import arguments, show
from poseppl.diagnostics.calibration import between
from poseppl.filters import Filter, assumed_density_filter, kalman_filter, window_filter
from poseppl.filters.scan import scan_filter
from poseppl.motion.geometry import marker_positions, paper_camera
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import make_problem, observe_motion
from poseppl.program import CompiledModel, Observation
from poseppl.runs.collectors import collect_draws
from poseppl.runs.run import Constant, frame_inputs

BOUNDS = (0.05, 0.25, 0.75, 0.95)


class Sequences(NamedTuple):
    """A model, its inputs (those of one frame, for all), data (S, T, ...) and true markers (S, T, 17, 3)."""

    model: CompiledModel
    inputs: Any
    observations: Observation
    markers: np.ndarray


def walks(count: int, num_frames: int) -> Sequences:
    """The same walk with different noise."""
    subject = walking_subject(frames=f"0:{num_frames}")
    scenes = [observe_motion(subject, paper_camera((0.0, -5000.0, 1000.0)), ["front"], seed=seed) for seed in range(count)]
    problems = [make_problem(scene) for scene in scenes]
    observations = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(problem.observations for problem in problems))
    truth = np.stack([np.asarray(scene.markers) for scene in scenes])
    return Sequences(problems[0].model, frame_inputs(problems[0].inputs, 0), observations, truth)


def simulations(count: int, num_frames: int) -> Sequences:
    """Sequences that the model itself draws."""
    problem = build_problem()
    drawn = [draw_sequence(problem, seed, num_frames) for seed in range(count)]
    observations = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(one.observations for one in drawn))
    positions = jax.vmap(jax.vmap(lambda x: marker_positions(problem.body.tree, x)))
    return Sequences(
        problem.model, problem.inputs, observations, np.asarray(positions(jnp.stack([one.states for one in drawn])))
    )


def filters(longest: int) -> Mapping[str, Callable[[CompiledModel], Filter]]:
    """The rivals by name."""
    windows = {
        f"window {size}": lambda model, size=size: window_filter(model, window=size) for size in (1, 2, 3, 5) if size <= longest
    }
    return {"extended-kalman": kalman_filter, "assumed-density": assumed_density_filter, **windows}


def run_of(filter: Filter, posed: Sequences) -> Callable[[jax.Array, Observation], tuple[Any, Any]]:
    """`(rng_key, observations (T, ...)) -> summaries and info, (T, ...)`."""
    collect = collect_draws(posed.model, max_draws=1, quantiles=BOUNDS)

    def kept(rng_key: jax.Array, state: Any, info: Any, inputs: Any) -> tuple[Any, Any]:
        return collect(rng_key, state, info, inputs).summary, info._replace(ancestors=jnp.zeros((), jnp.int32))

    def run(rng_key: jax.Array, observations: Observation) -> tuple[Any, Any]:
        found: tuple[Any, Any] = scan_filter(filter, rng_key, observations, Constant(posed.inputs), collect=kept).outputs
        return found

    return jax.jit(run)


class Found(NamedTuple):
    """For each sequence error in mm, coverages of 90 and 50 %, seconds a frame; over all frames rejection and gradients."""

    errors: np.ndarray
    wide: np.ndarray
    narrow: np.ndarray
    busy: np.ndarray
    seconds: np.ndarray
    rejection: float
    gradients: float


def study(filter: Filter, posed: Sequences) -> Found:
    """Run a filter over every sequence."""
    run = run_of(filter, posed)
    one = jax.tree.map(lambda leaf: leaf[0], posed.observations)
    ready = run.lower(jax.random.key(0), one).compile()  # type: ignore[attr-defined]
    rows = []
    for index, truth in enumerate(posed.markers):
        observations = jax.tree.map(lambda leaf, index=index: leaf[index], posed.observations)
        started, busy = time.perf_counter(), time.process_time()
        summary, info = jax.tree.map(np.asarray, ready(jax.random.key(index), observations))
        seconds = np.array([time.process_time() - busy, time.perf_counter() - started]) / len(truth)
        low, first, third, high = np.moveaxis(summary["markers_quantile"], 1, 0)
        error = np.linalg.norm(summary["markers_mean"] - truth, axis=-1).mean()
        hits = between(low, high, truth).mean(), between(first, third, truth).mean()
        rows.append((error, *hits, *seconds, 1 - info.acceptance.mean(), info.num_gradient.mean()))
    *each, rejection, gradients = np.array(rows).T
    return Found(*each, rejection.mean(), gradients.mean())


def main() -> None:
    options = arguments(__doc__, simulated=False, frames=30, sequences=4, longest=5)
    frames, count, longest = (3, 2, 2) if options.quick else (options.frames, options.sequences, options.longest)
    posed = (simulations if options.simulated else walks)(count, frames)
    rows = []
    for name, build in filters(longest).items():
        found = study(build(posed.model), posed)
        scaled = (found.errors, 100 * found.wide, 100 * found.narrow)
        shown = [f"{values.mean():.1f} ± {values.std(ddof=1) / np.sqrt(count):.1f}" for values in scaled]
        times = (f"{np.median(seconds):.3f}" for seconds in (found.busy, found.seconds))
        costs = [*times, f"{100 * found.rejection:.0f}", f"{found.gradients:.0f}"]
        rows.append([name, *shown, *costs])
        print(rows[-1], flush=True)
    kind = "simulated sequences" if options.simulated else "walks"
    columns = ["", "error mm", "in 90 %", "in 50 %", "CPU s a frame", "s", "rejected %", "gradients a frame"]
    show(f"{count} {kind} of {frames} frames, ± one standard error over sequences", columns, rows)


if __name__ == "__main__":
    main()
