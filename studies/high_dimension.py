"""Collapse of particle filters where the answer is known: a linear Gaussian model in 28 dimensions.

    python -m studies.high_dimension [--quick] [--dimension 28] [--frames 100] [--particles 10000] [--runs 5]

x_1 ~ N(0, I), x_t = A x_(t-1) + N(0, 0.1 I), the first half of the coordinates seen with noise N(0, 0.1 I); A is random with
spectral radius 0.9. Beside each filter: its log-evidence minus Kalman's (mean and standard deviation over runs: 0 is right),
the error of its filtered means (root mean square, against Kalman's means), and its time, the median of runs that take turns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.linear_gaussian import LinearGaussian, linear_gaussian_matrices, linear_gaussian_model

from benchmarks.timing import arguments, interleave, show
from poseppl.filters import Filter, guided_filter, particle_filter, tempered_filter
from poseppl.filters.scan import scan_filter
from poseppl.kernels import HMC_MOVES
from poseppl.program import CompiledModel, Observation

FILTERS: Mapping[str, Callable[[CompiledModel, int], Filter]] = {
    "particle (bootstrap)": particle_filter,
    "guided": guided_filter,
    "guided, auxiliary": lambda model, num: guided_filter(model, num, auxiliary=True),
    "tempered": tempered_filter,
    "tempered, one move": lambda model, num: tempered_filter(model, num, moves=HMC_MOVES._replace(num_moves=1)),
    "tempered, N / 10 particles": lambda model, num: tempered_filter(model, max(1, num // 10)),
}


class Exact(NamedTuple):
    """Kalman's log-evidence and filtered means (T, d)."""

    log_evidence: float
    means: np.ndarray


def build(dimension: int, num_frames: int, seed: int = 0) -> tuple[LinearGaussian, np.ndarray]:
    """The model's matrices, and data (T, d / 2)."""
    draw = np.random.default_rng(2000 + 100 * dimension + seed)
    A = draw.normal(size=(dimension, dimension))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    seen = dimension // 2
    x, ys = draw.normal(size=dimension), []
    for t in range(num_frames):
        if t:
            x = A @ x + np.sqrt(0.1) * draw.normal(size=dimension)
        ys.append(x[:seen] + np.sqrt(0.1) * draw.normal(size=seen))
    return linear_gaussian_matrices(dimension, seen, A=A, Q=0.1 * np.eye(dimension), R=0.1 * np.eye(seen)), np.stack(ys)


def kalman(matrices: LinearGaussian, ys: np.ndarray) -> Exact:
    """The textbook filter in float64."""
    A, Q, H, R, m, P, _ = matrices
    log_evidence, means = 0.0, []
    for t, y in enumerate(ys):
        if t:
            m, P = A @ m, A @ P @ A.T + Q
        S, residual = H @ P @ H.T + R, y - H @ m
        log_evidence -= 0.5 * (residual @ np.linalg.solve(S, residual) + np.linalg.slogdet(2 * np.pi * S)[1])
        gain = np.linalg.solve(S, H @ P).T
        m, P = m + gain @ residual, P - gain @ H @ P
        means.append(m)
    return Exact(float(log_evidence), np.stack(means))


def evidence_and_means(filter_: Filter, observations: Observation) -> Callable[[jax.Array], Any]:
    """From a key to the log-evidence and the filtered means (T, d), compiled."""

    @jax.jit
    def run(rng_key: jax.Array) -> tuple[jax.Array, jax.Array]:
        def keep(rng_key: jax.Array, state: Any, info: Any, inputs: Any) -> tuple[jax.Array, jax.Array]:
            return info.log_evidence, jnp.exp(state.log_weights) @ state.particles

        log_evidence, means = scan_filter(filter_, rng_key, observations, collect=keep).outputs
        return log_evidence.sum(), means

    return run


def main() -> None:
    options = arguments(__doc__, dimension=28, frames=100, particles=10_000, runs=5)
    frames, particles, runs = (5, 50, 1) if options.quick else (options.frames, options.particles, options.runs)
    matrices, ys = build(options.dimension, frames)
    exact = kalman(matrices, ys)
    model = linear_gaussian_model(matrices).compile()
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in FILTERS}

    def rival(name: str, build: Callable[[CompiledModel, int], Filter]) -> Callable[[], Any]:
        run = evidence_and_means(build(model, particles), model.observe({"y": ys}))

        def once() -> None:
            log_evidence, means = jax.block_until_ready(run(jax.random.key(len(found[name]))))
            error = np.sqrt(((np.asarray(means, float) - exact.means) ** 2).mean())
            found[name].append((float(log_evidence) - exact.log_evidence, float(error)))

        return once

    seconds = interleave({name: rival(name, build) for name, build in FILTERS.items()}, runs)
    rows = []
    for name, timing in seconds.items():
        difference, error = np.array(found[name]).T
        spread = f"{difference.mean():.1f} +- {difference.std(ddof=1):.1f}"
        rows.append([name, spread, f"{error.mean():.3f}", f"{timing.median:.2f}", f"{timing.first - timing.median:.1f}"])
    title = f"d = {options.dimension}, T = {frames}, N = {particles:,}"
    show(title, ["", "log-evidence - Kalman's", "error of means", "seconds", "compile s"], rows)


if __name__ == "__main__":
    main()
