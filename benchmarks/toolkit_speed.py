"""Processor seconds of the toolkit's typical work, each beside a rival in the same run.

    python -m benchmarks.toolkit_speed [--quick] [--repetitions 3] [--output toolkit-speed]

* 1,000 series of 200 frames in one call of `infer_batch`, beside a loop of `infer` over 20 of them (seconds a series): a level
  in one dimension, seen with noise.
* The bootstrap filter through `run_filter`, N = 10,000, T = 100, on the growth model, beside a scan written by hand.
* Viterbi beside forward-backward, N = 5,000, T = 100, on the growth model, the filter included in both.

Rivals run in turns, and the medians of runs after the first count, which compiles. Processor seconds are those of all threads.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.growth import VARIANCE, growth_mean
from poseppl_models.toys.linear_gaussian import linear_gaussian
from poseppl_papers.peursum.dimensionality import growth_sets, run_of
from poseppl_papers.tables import Table

import poseppl
from benchmarks.timing import arguments, show, write_table
from poseppl.smoothers import forward_backward_smoother, viterbi_smoother

NAME = "toolkit_speed"
_COLUMNS = ("job", "rival", "seconds", "rival_seconds", "goal")
_ABOUT = "Processor seconds of a job and of its rival, and what the goal allows of their ratio; 0 where there is none."


class Pair(NamedTuple):
    """A job, its rival, what their ratio may be at most, and how many times as much the job and the rival do as they tell."""

    job: str
    rival: str
    run: Callable[[], Any]
    run_rival: Callable[[], Any]
    goal: float = 0.0
    times: tuple[int, int] = (1, 1)


def batches(quick: bool) -> list[Pair]:
    """Many series in one call, and one by one."""
    series, frames, looped = (20, 10, 2) if quick else (1000, 200, 20)
    model = linear_gaussian(1).compile()
    data = np.random.default_rng(0).normal(size=(series, frames, 1)).cumsum(1) * 0.3
    key, collect = jax.random.key(0), poseppl.collect_draws(model, max_draws=20)

    def pair(name: str, filter: Any) -> Pair:
        def loop() -> list[Any]:
            return [poseppl.infer(model, {"y": one}, filter, key, collect=collect) for one in data[:looped]]

        def batch() -> Any:
            return poseppl.infer_batch(model, {"y": data}, filter, key, collect=collect)

        return Pair(f"{series:,} series of {frames} frames, {name}, a series", "a loop", batch, loop, times=(series, looped))

    particle, kalman = poseppl.particle_filter(model, 200), poseppl.kalman_filter(model, num_particles=200)
    return [pair("particle, N = 200", particle), pair("Kalman, 200 draws", kalman)]


def growth_pairs(quick: bool) -> list[Pair]:
    """The bootstrap filter and Viterbi, each with its rival, on one series."""
    many, few, frames = (200, 100, 10) if quick else (10_000, 5_000, 100)
    posed = growth_sets(1, frames)
    data, key = jax.tree.map(lambda leaf: leaf[0], posed.observations), jax.random.key(0)
    filter, scan = poseppl.particle_filter(posed.model, many), jax.jit(lambda key, ys: hand_written(key, ys, many))
    ys = jnp.asarray(posed.values[0, :, 0], jnp.float32)
    builders = viterbi_smoother, forward_backward_smoother
    viterbi, both_ways = (run_of(posed, few, lambda model, num, build=build: build(model)) for build in builders)  # type: ignore[misc]
    return [
        Pair(
            f"bootstrap filter, N = {many:,}, T = {frames}",
            "a scan written by hand",
            lambda: poseppl.run_filter(filter, key, data, posed.times, collect=weighted_mean).outputs,
            lambda: scan(key, ys),
            goal=1.5,
        ),
        Pair(
            f"Viterbi, N = {few:,}, T = {frames}",
            "forward-backward",
            lambda: viterbi(key, data),
            lambda: both_ways(key, data),
            goal=2.0,
        ),
    ]


def weighted_mean(rng_key: Any, state: Any, info: Any, inputs: Any) -> Any:
    """Outputs that the scan by hand also keeps."""
    return jnp.exp(state.log_weights) @ state.particles[:, 0]


def hand_written(rng_key: Any, ys: Any, num_particles: int) -> tuple[Any, Any]:
    """The bootstrap filter of the growth model, systematic resampling at every frame: means (T,) and log-evidence (T,)."""

    def weigh(xs: Any, y: Any) -> tuple[Any, Any, Any]:
        log_weights = -0.5 * (y - xs * xs / 20) ** 2
        largest = log_weights.max()
        weights = jnp.exp(log_weights - largest)
        total = weights.sum()
        return weights / total, weights @ xs / total, largest + jnp.log(total / num_particles) - 0.5 * jnp.log(2 * jnp.pi)

    def step(before: tuple[Any, Any], frame: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        (xs, weights), (key, y, t) = before, frame
        offset, noise = jax.random.uniform(key), jax.random.normal(jax.random.fold_in(key, 1), (num_particles,))
        ends = jnp.clip(jnp.ceil(num_particles * jnp.cumsum(weights) - offset), 0, num_particles).astype(jnp.int32)
        first = jnp.zeros(num_particles + 1, jnp.int32).at[ends].add(1)
        ancestors = jnp.clip(jnp.cumsum(first)[:-1], 0, num_particles - 1)
        xs = growth_mean(xs[ancestors], t) + VARIANCE**0.5 * noise
        weights, mean, evidence = weigh(xs, y)
        return (xs, weights), (mean, evidence)

    keys = jax.random.split(rng_key, len(ys))
    xs = VARIANCE**0.5 * jax.random.normal(keys[0], (num_particles,))
    weights, mean, evidence = weigh(xs, ys[0])
    _, rest = jax.lax.scan(step, (xs, weights), (keys[1:], ys[1:], jnp.arange(2.0, len(ys) + 1)))
    return tuple(jnp.concatenate([one[None], others]) for one, others in zip((mean, evidence), rest, strict=True))  # type: ignore[return-value]


def measure(pair: Pair, repetitions: int) -> tuple[float, float]:
    """Median processor seconds of the job and of its rival, each for one of what it does many of."""
    seconds: tuple[list[float], list[float]] = ([], [])
    for _ in range(repetitions + 1):
        for run, found in zip((pair.run, pair.run_rival), seconds, strict=True):
            started = time.process_time()
            jax.block_until_ready(run())
            found.append(time.process_time() - started)
    job, rival = (statistics.median(found[1:]) / times for found, times in zip(seconds, pair.times, strict=True))
    return job, rival


def main() -> None:
    options = arguments(__doc__, repetitions=3, output="toolkit-speed")
    pairs = [*batches(options.quick), *growth_pairs(options.quick)]
    rows = [(pair.job, pair.rival, *measure(pair, 1 if options.quick else options.repetitions), pair.goal) for pair in pairs]
    note = "the machine ran other work"
    write_table(Table(NAME, _COLUMNS, rows, _ABOUT), options.output, str(options.repetitions), "none", note)
    shown = [[*row[:2], f"{1e3 * row[2]:,.1f}", f"{1e3 * row[3]:,.1f}", f"{row[2] / row[3]:.2f}"] for row in rows]
    show("Processor milliseconds", ["job", "rival", "job", "rival", "ratio"], shown)


if __name__ == "__main__":
    main()
