"""Frames a second of the filters on the 28-DOF body, and what the HMC filter costs around the bare BlackJAX kernel.

    python -m benchmarks.filters [--quick] [--frames 25]

Every filter runs over the same simulated sequence in one scan. Beside its rate are the seconds of its first call (with tracing
and compilation) and the largest memory of a process that ran it alone. The bare kernel makes the HMC filter's updates on the
posterior of one frame, with the same number of chains, updates and gradients, and nothing around it.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping
from typing import Any

import blackjax
import jax
import jax.numpy as jnp

from benchmarks.simulated import build_problem, draw_sequence
from benchmarks.timing import arguments, interleave, peak_memory, show
from poseppl.filters import Filter, assumed_density_filter, hmc_filter, particle_filter
from poseppl.filters.scan import scan_filter
from poseppl.kernels import HMCSettings, whitening
from poseppl.program import CompiledModel, Observation
from poseppl.program.frame_inputs import Constant

CHAINS, PAPER = 10, HMCSettings(num_updates=32, num_leapfrog=40, num_warmup=6)

FILTERS: Mapping[str, Callable[[CompiledModel], Filter]] = {
    "hmc: 10 chains, L 40, R 32, b 6": lambda model: hmc_filter(model, CHAINS, PAPER),
    "assumed-density, default": assumed_density_filter,
    "particle, N = 100,000": lambda model: particle_filter(model, 100_000),
}


def prepared(build: Callable[[CompiledModel], Filter], num_frames: int) -> Callable[[], Any]:
    """Prepare a filter's run over a simulated sequence, keeping the posterior means alone."""
    problem = build_problem()
    observations = draw_sequence(problem, 0, num_frames).observations
    tracker = build(problem.model)

    @jax.jit
    def run(rng_key: jax.Array, observations: Observation) -> jax.Array:
        def mean(rng_key: jax.Array, state: Any, info: Any, inputs: Any) -> jax.Array:
            return jax.nn.softmax(state.log_weights.ravel()) @ state.particles.reshape(-1, problem.model.dimension)

        found: jax.Array = scan_filter(tracker, rng_key, observations, Constant(problem.inputs), collect=mean).outputs
        return found

    return lambda: run(jax.random.key(1), observations)


def measure_memory(name: str, num_frames: int, answer: Any) -> None:
    """Run a filter alone, in a process of its own, and send its largest memory."""
    jax.block_until_ready(prepared(FILTERS[name], num_frames)())
    answer.put(peak_memory())


def report_filters(num_frames: int, repetitions: int) -> None:
    """Frames a second, seconds of the first call, memory."""
    seconds = interleave({name: prepared(build, num_frames) for name, build in FILTERS.items()}, repetitions)
    context = multiprocessing.get_context("spawn")
    rows = []
    for name, timing in seconds.items():
        answer = context.Queue()
        process = context.Process(target=measure_memory, args=(name, num_frames, answer))
        process.start()
        memory = answer.get(timeout=600)
        process.join()
        rate = f"{num_frames / timing.median:.1f}"
        rows.append(
            [name, rate, f"{1e3 * timing.median / num_frames:.1f}", f"{timing.first - timing.median:.1f}", f"{memory:.0f}"]
        )
    show("Filters, 28 DOF, 17 markers, one camera", ["", "frames/s", "ms a frame", "compile s", "peak MiB"], rows)


def report_overhead(settings: HMCSettings, repetitions: int) -> None:
    """One frame of the HMC filter beside the bare kernel."""
    problem = build_problem()
    model, inputs = problem.model, problem.inputs
    observations = draw_sequence(problem, 0, 2).observations
    first, second = (jax.tree.map(lambda leaf, frame=frame: leaf[frame], observations) for frame in (0, 1))
    tracker = hmc_filter(model, CHAINS, settings)
    state, _ = jax.jit(tracker.init)(jax.random.key(0), first, inputs)
    step, bare = jax.jit(tracker.step), jax.jit(bare_kernel(model, settings))
    key, last = jax.random.key(1), state.particles[:, -1]
    seconds = interleave(
        {"filter": lambda: step(key, state, second, inputs), "bare": lambda: bare(key, last, second, inputs)}, repetitions
    )
    overhead = seconds["filter"].median / seconds["bare"].median - 1
    gradients = CHAINS * (1 + settings.num_updates * settings.num_leapfrog)
    rows = [
        [name, f"{1e3 * timing.median:.1f}", f"{gradients / timing.median / 1e3:.0f}", f"{timing.first - timing.median:.1f}"]
        for name, timing in (("HMC filter, one frame", seconds["filter"]), ("bare BlackJAX kernel", seconds["bare"]))
    ]
    show(f"{gradients:,} gradients", ["", "ms", "thousand gradients/s", "compile s"], rows)
    print(f"The filter costs {100 * overhead:+.1f} % on top of the bare kernel (goal: at most 10 %).")


def bare_kernel(model: CompiledModel, settings: HMCSettings) -> Callable[..., jax.Array]:
    """BlackJAX's HMC in a scan, from the last states of all chains, on the density that the filter samples."""

    def run(rng_key: jax.Array, last: jax.Array, observation: Observation, inputs: Any) -> jax.Array:
        mean, covariance = model.transition_moments(jnp.mean(last, 0), inputs)
        precision = jnp.linalg.inv(covariance) + model.observation_information(mean, observation, inputs)
        chart = whitening(mean, precision, dense=False)

        def log_density(z: jax.Array) -> jax.Array:
            x = chart.to_state(z)
            terms = jax.vmap(lambda previous: model.log_transition(x, previous, inputs))(last)
            return model.log_observation(x, observation, inputs) + jax.nn.logsumexp(terms)

        kernel, mass = blackjax.hmc.build_kernel(), jnp.ones(model.dimension)

        def update(states: Any, key: jax.Array) -> tuple[Any, jax.Array]:
            move = jax.vmap(lambda k, s: kernel(k, s, log_density, settings.step_size, mass, settings.num_leapfrog))
            states, _ = move(jax.random.split(key, CHAINS), states)
            return states, states.position

        states = jax.vmap(lambda z: blackjax.hmc.init(z, log_density))(chart.to_white(last))
        return jax.lax.scan(update, states, jax.random.split(rng_key, settings.num_updates))[1]

    return run


def main() -> None:
    options = arguments(__doc__, frames=25)
    report_filters(3 if options.quick else options.frames, 1 if options.quick else 7)
    report_overhead(PAPER, 3 if options.quick else 21)


if __name__ == "__main__":
    main()
