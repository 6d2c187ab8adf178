"""Many series in one call beside a loop over them: seconds a series, compilation left out.

    python benchmarks/batches.py [--series 1000] [--frames 200] [--particles 200] [--looped 30]

A level in one dimension, seen with noise; the loop filters the first of the series one by one, with the same filter, compiled
once, and as many draws kept.
"""

from __future__ import annotations

import argparse
import time

import jax
import numpy as np
from poseppl_models.linear_gaussian import linear_gaussian

import poseppl


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("series", 1000), ("frames", 200), ("particles", 200), ("looped", 30)):
        parser.add_argument(f"--{name}", type=int, default=default)
    wanted = parser.parse_args()
    model = linear_gaussian(1).compile()
    data = np.random.default_rng(0).normal(size=(wanted.series, wanted.frames, 1)).cumsum(1) * 0.3
    collect = poseppl.collect_draws(model, max_draws=20)
    print(f"{wanted.series} series of {wanted.frames} frames; seconds a series")
    for name, filter in (
        (f"particle, N = {wanted.particles}", poseppl.particle_filter(model, wanted.particles)),
        (f"Kalman, {wanted.particles} draws", poseppl.kalman_filter(model, num_particles=wanted.particles)),
    ):
        batch = seconds(lambda: poseppl.infer_batch(model, {"y": data}, filter, jax.random.key(0), collect=collect))  # noqa: B023
        loop = seconds(
            lambda: [
                poseppl.infer(model, {"y": one}, filter, jax.random.key(0), collect=collect)  # noqa: B023
                for one in data[: wanted.looped]
            ]
        )
        each, alone = batch / wanted.series, loop / wanted.looped
        print(f"{name:<22}  in one call {each:.5f} ({batch:.1f} s in all)   in a loop {alone:.5f}   ratio {alone / each:.1f}")


def seconds(run) -> float:
    """The second of two runs: the first compiles."""
    run()
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


if __name__ == "__main__":
    main()
