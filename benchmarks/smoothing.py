"""Time and error of the particle smoothers on the growth model, beside a hand-written forward-backward scan in the same run.

    python -m benchmarks.smoothing [--quick] [--repetitions 20]

T = 100 frames; filter and smoother are timed together, in turns. Beside the wall clock stands the processor time of the whole
process, which counts the same on a busy machine. The error is the root mean square distance over the frames between the
estimated smoothed mean and the exact one, which a grid gives, averaged over data sets.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_papers.peursum.dimensionality import Growth, Run, growth_sets, run_of

from benchmarks.timing import arguments, show
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers import (
    History,
    Smoothed,
    Smoother,
    backward_simulation_smoother,
    fixed_lag_smoother,
    forward_backward_smoother,
    genealogy_smoother,
    two_filter_smoother,
    viterbi_smoother,
)


def hand_written(tile: int = 100) -> Smoother:
    """Forward-backward reweighting of the one-dimensional growth model, written for nothing else: the yardstick of speed."""

    def smooth(rng_key: Any, history: History, observations: Observation, inputs: jax.Array) -> Smoothed:
        xs, weights = history.particles[..., 0], jnp.exp(history.log_weights)
        count = xs.shape[1]
        missing = -count % tile

        def tiles(row: jax.Array) -> jax.Array:
            return jnp.pad(row, (0, missing)).reshape(-1, tile)

        def back(smoothed: jax.Array, frame: Any) -> tuple[jax.Array, jax.Array]:
            x, w, later, time = frame
            centre = x / 2 + 25 * x / (1 + x * x) + 8 * jnp.cos(1.2 * time)

            def part(total: jax.Array, rows: Any) -> tuple[jax.Array, None]:
                densities = jnp.exp(-0.05 * (rows[0][:, None] - centre) ** 2)
                return total + (rows[1] / jnp.maximum(densities @ w, 1e-37)) @ densities, None

            total, _ = jax.lax.scan(part, jnp.zeros_like(w), (tiles(later), tiles(smoothed)))
            return w * total, w * total

        _, rest = jax.lax.scan(back, weights[-1], (xs[:-1], weights[:-1], xs[1:], inputs[1:]), reverse=True)
        smoothed = jnp.concatenate([rest, weights[-1:]])
        return Smoothed(history.particles, jnp.log(smoothed), None)  # type: ignore[arg-type]

    return Smoother(smooth, joint=False)


Builder = Callable[[CompiledModel, int], Smoother]

SMOOTHERS: Mapping[str, Builder | None] = {
    "filter alone": None,
    "genealogy": lambda model, num: genealogy_smoother(model),
    "fixed lag, 10": lambda model, num: fixed_lag_smoother(model, lag=10),
    "backward simulation, 1 move": lambda model, num: backward_simulation_smoother(model, num, method="metropolis"),
    "backward simulation, 5 moves": lambda model, num: backward_simulation_smoother(
        model, num, method="metropolis", num_moves=5
    ),
    "two-filter, 1 pair": lambda model, num: two_filter_smoother(model, method="linear", num_pairs=1),
    "two-filter, 4 pairs": lambda model, num: two_filter_smoother(model, method="linear"),
    "hand-written scan": lambda model, num: hand_written(),
    "forward-backward": lambda model, num: forward_backward_smoother(model),
    "backward simulation, exact": lambda model, num: backward_simulation_smoother(model, num),
    "two-filter, exact": lambda model, num: two_filter_smoother(model),
    "Viterbi": lambda model, num: viterbi_smoother(model),
}


def measure(posed: Growth, runs: Mapping[str, Run], repetitions: int) -> list[list[str]]:
    """Rows of name, compile seconds, wall and processor milliseconds, and error; the runs take turns."""
    names = list(runs)
    wall: dict[str, list[float]] = {name: [] for name in names}
    processor: dict[str, list[float]] = {name: [] for name in names}
    errors: dict[str, list[float]] = {name: [] for name in names}
    exact = posed.exact()[1]
    for repetition in range(repetitions + 1):
        which = repetition % len(exact)
        observations = jax.tree.map(lambda leaf, which=which: leaf[which], posed.observations)
        for name in names:
            started, used = time.perf_counter(), time.process_time()
            _, smoothed = jax.block_until_ready(runs[name](jax.random.key(repetition), observations))
            wall[name].append(time.perf_counter() - started)
            processor[name].append(time.process_time() - used)
            errors[name].append(float(np.sqrt(np.mean((np.asarray(smoothed) - exact[which]) ** 2))))
    rows = []
    for name in names:
        middle = statistics.median(wall[name][1:])
        rows.append(
            [
                name,
                f"{wall[name][0] - middle:.1f}",
                f"{1e3 * middle:.0f}",
                f"{1e3 * min(wall[name][1:]):.0f}",
                f"{1e3 * statistics.median(processor[name][1:]):.0f}",
                f"{statistics.mean(errors[name]):.3f}",
                f"{statistics.stdev(errors[name]) / len(errors[name]) ** 0.5:.3f}",
            ]
        )
    return rows


def main() -> None:
    options = arguments(__doc__, repetitions=20)
    posed = growth_sets(3 if options.quick else 20, 12 if options.quick else 100)
    for num_particles in [200] if options.quick else [500, 2000, 5000]:
        runs = {name: run_of(posed, num_particles, build) for name, build in SMOOTHERS.items()}
        rows = measure(posed, runs, 2 if options.quick else options.repetitions)
        columns = ["", "compile s", "ms", "least", "processor ms", "error", "+-"]
        show(f"N = {num_particles:,}, T = {posed.times.shape[0]}, filter included", columns, rows)


if __name__ == "__main__":
    main()
