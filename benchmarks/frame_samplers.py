"""One frame, its posterior known: the tempered filter beside BlackJAX's adaptive tempered SMC and persistent sampling.

    python -m benchmarks.frame_samplers [--quick] [--repeats 50] [--output frame_samplers]

Frames are the banana of notebook 04, one three times thinner, and the first frame of high_dimension.py. All move by HMC, as
often and as far as the tempered filter by default; it adapts the step size and the scale of each direction, BlackJAX's take one
step size, here the best of several, found with the answer. Beside each: gradients, draws that are worth as much (variance over
the mean squared error of the mean, over coordinates and repeats, with its standard error), these for 1,000 gradients, and the
error of the log-evidence (mean, standard deviation).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
from blackjax.smc.resampling import systematic
from jax import Array
from poseppl_models.toys.banana import banana
from poseppl_models.toys.linear_gaussian import linear_gaussian_model
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.filters import tempered_filter
from poseppl.kernels import HMC_MOVES
from poseppl.program import CompiledModel, Observation
from poseppl.program.population import draw_initial
from studies.high_dimension import build, kalman

STEP_SIZES = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
MOST = 100
"""Temperatures at most."""
TARGETS = {"adaptive tempered SMC": 0.5, "persistent sampling": 3.0}
"""Effective share of the particles of a temperature, and of one temperature's particles among those of all."""


class Frame(NamedTuple):
    """A model and the data of its first frame; exact mean and variances (d,), and log-evidence."""

    model: CompiledModel
    data: Observation
    mean: np.ndarray
    variance: np.ndarray
    log_evidence: float


class Found(NamedTuple):
    """Means (R, d), log-evidences (R,) and gradients (R,) of repeats."""

    means: Array
    log_evidence: Array
    gradients: Array


def banana_frame(noise: float) -> Frame:
    """The banana, by a grid."""
    model = banana(curvature=1.0, noise=noise).compile()
    data = model.observe({"y": 1.0})
    axis = np.linspace(-4.5, 4.5, 3001)
    a, b = np.meshgrid(axis, axis, indexing="ij")
    log_density = -0.5 * (a**2 + b**2) - np.log(2 * np.pi)
    log_density += -0.5 * ((1.0 - b - a**2) / noise) ** 2 - np.log(noise * np.sqrt(2 * np.pi))
    density = np.exp(log_density)
    share = density / density.sum()
    mean = np.array([(share * a).sum(), (share * b).sum()])
    variance = np.array([(share * (a - mean[0]) ** 2).sum(), (share * (b - mean[1]) ** 2).sum()])
    return Frame(model, data, mean, variance, float(np.log(density.sum() * (axis[1] - axis[0]) ** 2)))


def linear_frame() -> Frame:
    """28 coordinates, of which half are seen."""
    matrices, ys = build(28, 1)
    exact, (H, R, P) = kalman(matrices, ys), (np.asarray(part, float) for part in (matrices.H, matrices.R, matrices.P))
    model = linear_gaussian_model(matrices).compile()
    variance = np.diag(P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P))
    return Frame(model, model.observe({"y": ys[0]}), exact.means[0], variance, exact.log_evidence)


def ours(frame: Frame, particles: int, keys: Array) -> Found:
    """The first frame of the tempered filter."""
    filter = tempered_filter(frame.model, particles)

    def once(key: Array) -> Found:
        state, info = filter.init(key, frame.data)
        return Found(jnp.exp(state.log_weights) @ state.particles, info.log_evidence, info.num_gradient)

    found: Found = jax.jit(partial(jax.lax.map, once))(keys)
    return found


def blackjaxs(name: str, frame: Frame, particles: int, step_size: float, keys: Array) -> Found:
    """BlackJAX's samplers, until the temperature is 1."""
    model, moves = frame.model, HMC_MOVES
    kernel = blackjax.hmc.build_kernel()
    each = (1 + moves.num_moves * moves.num_leapfrog) * particles

    def step(rng_key: Array, state: Any, log_density: Callable[..., Array], **parameters: Any) -> Any:
        return kernel(rng_key, state, log_density, num_integration_steps=moves.num_leapfrog, **parameters)

    shared = {"step_size": jnp.asarray([step_size]), "inverse_mass_matrix": jnp.ones((1, model.dimension))}
    given: dict[str, Any] = {
        "logprior_fn": model.log_initial,
        "loglikelihood_fn": lambda x: model.log_observation(x, frame.data),
        "mcmc_step_fn": step,
        "mcmc_init_fn": blackjax.hmc.init,
        "mcmc_parameters": shared,
        "resampling_fn": systematic,
        "num_mcmc_steps": moves.num_moves,
        "target_ess": TARGETS[name],
    }
    persistent = name == "persistent sampling"
    if persistent:
        sampler = blackjax.adaptive_persistent_sampling_smc(max_iterations=MOST, **given)
    else:
        sampler = blackjax.adaptive_tempered_smc(**given)

    def once(key: Array) -> Found:
        key_start, key_run = jax.random.split(key)
        start = sampler.init(draw_initial(model, jax.random.split(key_start, particles), None))
        if not persistent:
            start = start._replace(tempering_param=jnp.zeros(()))

        def colder(carry: Any) -> Any:
            state, number, log_evidence = carry
            state, info = sampler.step(jax.random.fold_in(key_run, number), state)
            added = jnp.zeros(()) if persistent else info.log_likelihood_increment
            return state, number + 1, log_evidence + added

        def warm(carry: Any) -> Array:
            return (carry[0].tempering_param < 1) & (carry[1] < MOST)

        state, number, log_evidence = jax.lax.while_loop(warm, colder, (start, 0, jnp.zeros(())))
        if persistent:
            weights = state.persistent_weights / jnp.sum(state.persistent_weights)
            mean = jnp.tensordot(weights, state.persistent_particles, 2)
            return Found(mean, state.log_Z, number * each)
        return Found(state.weights @ state.particles, log_evidence, number * each)

    found: Found = jax.jit(partial(jax.lax.map, once))(keys)
    return found


def worth(frame: Frame, found: Found) -> tuple[float, float]:
    """Independent draws whose mean errs as much, and the standard error of this number."""
    squares = np.mean((np.asarray(found.means, float) - frame.mean) ** 2 / frame.variance, axis=1)
    number = 1 / squares.mean()
    return number, number * squares.std(ddof=1) / np.sqrt(len(squares)) / squares.mean()


def row(name: str, sampler: str, frame: Frame, found: Found) -> tuple[Any, ...]:
    """A row of the table."""
    number, error = worth(frame, found)
    gradients = float(np.mean(np.asarray(found.gradients, float)))
    evidence = np.asarray(found.log_evidence, float) - frame.log_evidence
    shares = 1000 * number / gradients, 1000 * error / gradients
    return name, sampler, gradients, number, *shares, float(evidence.mean()), float(evidence.std(ddof=1))


def main() -> None:
    options = arguments(__doc__, repeats=50, output="frame_samplers")
    start_jax()
    repeats, particles = (3, 50) if options.quick else (options.repeats, 400)
    keys = jax.random.split(jax.random.key(0), repeats)
    frames = {"banana": banana_frame(0.15), "thin banana": banana_frame(0.05), "linear, d = 28": linear_frame()}
    columns = ("frame", "sampler", "gradients", "worth", "per_1000", "per_1000_error", "evidence", "evidence_sd")
    about = "Gradients of a frame, independent draws that it is worth, these for 1,000 gradients, error of the log-evidence."
    table = Table("frame_samplers", columns, [], about)
    for name, frame in frames.items():
        table.rows.append(row(name, "tempered filter", frame, ours(frame, particles, keys)))
        for sampler in TARGETS:
            tried = {step: blackjaxs(sampler, frame, particles, step, keys) for step in STEP_SIZES}
            best = max(tried, key=lambda step: worth(frame, tried[step])[0] / float(tried[step].gradients.mean()))
            table.rows.append(row(name, f"{sampler}, step size {best:g}", frame, tried[best]))
    shown = [[value if isinstance(value, str) else f"{value:.3g}" for value in each] for each in table.rows]
    show("One frame", [*columns], shown)
    output = options.output
    write_csv(table, output)


if __name__ == "__main__":
    main()
