"""Evaluations a second of the bodytrack benchmark's likelihood, from every sample and from few, and the error of few samples.

    NPROC=1 taskset -c 0 python -m benchmarks.bodytrack [--quick] [--data FOLDER]                one core, one device
    XLA_FLAGS=--xla_force_host_platform_device_count=2 NPROC=1 python -m benchmarks.bodytrack    two, half the poses on each

An evaluation is a pose of 31 coordinates in four cameras of 640 x 480. FOLDER (or $POSEPPL_DATA) holds the recordings. The C++
figures are those of the benchmark's own tracker, published in NOTES.md beside its data: they are from a run on another machine
at another time, g++ -O3 -march=native, and tell an order of magnitude, not a ratio. 10,000 particles a frame are what Peursum,
Venkatesh and West (2010, doi:10.1007/s11263-009-0205-5) give their filters.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodytrack.files import Bodytrack, read_bodytrack
from poseppl_models.bodytrack.likelihood import benchmark_score

from benchmarks.timing import interleave, show

PUBLISHED = {1: 125_000, 2: 240_000}
PARTICLES = 10_000


def score_of(data: Bodytrack, every: bool):
    """Compiled scores (D, N / D) of states (D, N / D, 31), one row on each of D devices."""
    inputs, body = data.inputs(), data.body

    def score(state: jax.Array) -> jax.Array:
        return benchmark_score(body, state, inputs, every=every)

    return jax.pmap(jax.vmap(score))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tiny size, to see that it runs")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("POSEPPL_DATA", "data")), help="the recordings")
    options = parser.parse_args()
    data = read_bodytrack(options.data / "parsec_bodytrack" / "sequenceB_1")
    count = 500 if options.quick else PARTICLES
    noise = np.random.default_rng(0).normal(size=(count, 31))
    devices = jax.local_device_count()
    states = jnp.asarray(data.start + data.step_scale * noise, float).reshape(devices, -1, 31)
    scores = {"few samples, weighted": score_of(data, False), "every sample": score_of(data, True)}
    rivals = {name: lambda score=score: score(states) for name, score in scores.items()}
    seconds = interleave(rivals, 2 if options.quick else 9)
    rows = [
        [name, f"{count / timing.median:,.0f}", f"{1e3 * PARTICLES * timing.median / count:.0f}", f"{timing.first:.1f}"]
        for name, timing in seconds.items()
    ]
    for number, rate in PUBLISHED.items():
        rows.append([f"C++, {number} core(s), another machine", f"{rate:,}", f"{1e3 * PARTICLES / rate:.0f}", ""])
    title = f"Likelihoods of bodytrack, N = {count:,}, {devices} device(s)"
    show(title, ["", "a second", f"ms for {PARTICLES:,} (a frame)", "first call s"], rows)
    few, every = (np.asarray(score(states), float).ravel() for score in scores.values())
    print(
        f"Few samples: error {np.mean(few - every):+.4f} on average, {np.sqrt(np.mean((few - every) ** 2)):.4f} rms, where the "
        f"score varies by {every.std():.4f} (sd); correlation {np.corrcoef(few, every)[0, 1]:.4f}."
    )


if __name__ == "__main__":
    main()
