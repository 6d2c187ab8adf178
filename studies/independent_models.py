"""Models of many fields with data and exact answers: linear and Gaussian, chains, switching, counts and others on a grid.

They are those on which users of other libraries report trouble, and others that sample each kind of site.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from scipy import special, stats

import poseppl
from studies.exact_posteriors import CHAIN, COUNT, GAUSSIAN, GRID, Array, Exact, joint_gaussian, markov, on_grid


class Case(NamedTuple):
    """A model with data, the exact answers about one of its quantities, and the algorithms that are tried."""

    programs: poseppl.StateSpaceModel
    data: dict[str, Any]
    quantity: str
    exact: Exact
    against: str
    algorithms: tuple[tuple[str, str], ...] = (("particle", "backward-simulation"),)
    inputs: Any = None


EXACT = ("kalman", "rauch-tung-striebel")
PARTICLES = ("particle", "backward-simulation")
RNG = np.random.default_rng(5)


def model(
    initial: Callable[..., Any], transition: Callable[..., Any], observation: Callable[..., Any]
) -> poseppl.StateSpaceModel:
    """A model of programs without params."""
    return poseppl.StateSpaceModel(
        lambda params, inputs: initial(inputs),
        lambda params, state, inputs: transition(state, inputs),
        lambda params, state, inputs: observation(state, inputs),
    )


def with_gap(values: Any) -> Array:
    """The data without those of two frames."""
    found = np.array(values, float)
    found[[3, 4]] = np.nan
    return found


# Linear and Gaussian


def lag() -> Case:
    """An AR(2) whose second lag is carried along without noise."""

    def transition(state: Any, inputs: Any) -> None:
        numpyro.sample("before", dist.Delta(state["now"]))
        numpyro.sample("now", dist.Normal(1.6 * state["now"] - 0.8 * state["before"], 0.5))

    def initial(inputs: Any) -> None:
        numpyro.sample("now", dist.Normal(0.0, 1.0))
        numpyro.sample("before", dist.Normal(0.0, 1.0))

    data = with_gap(2 * np.sin(0.6 * np.arange(COUNT)) + 0.7 * RNG.normal(size=COUNT))
    exact = joint_gaussian(data, [[1.6, -0.8], [1, 0]], np.diag([0.25, 0]), [[1, 0]], [[0.49]], (np.zeros(2), np.eye(2)), 0)
    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["now"], 0.7)))
    return Case(programs, {"y": data}, "now", exact, GAUSSIAN, (PARTICLES, EXACT, ("particle", "genealogy")))


def integrated() -> Case:
    """A position that integrates a velocity without noise, seen at uneven times."""
    steps = np.array([1.0, 0.5, 2.0, 0.2, 1.0, 1.5, 0.3, 0.7, 1.0, 0.4])

    def initial(inputs: Any) -> None:
        numpyro.sample("position", dist.Normal(0.0, 2.0))
        numpyro.sample("velocity", dist.Normal(0.0, 1.0))

    def transition(state: Any, inputs: Any) -> None:
        numpyro.sample("position", dist.Delta(state["position"] + inputs["dt"] * state["velocity"]))
        decay = jnp.exp(-0.3 * inputs["dt"])
        numpyro.sample("velocity", dist.Normal(decay * state["velocity"], jnp.sqrt(1 - decay**2)))

    data = with_gap(np.cumsum(steps) * 0.5 + 0.5 * RNG.normal(size=COUNT))
    decays = np.exp(-0.3 * steps)
    matrix = np.stack([np.array([[1, dt], [0, decay]]) for dt, decay in zip(steps, decays, strict=True)])
    noise = np.stack([np.diag([0, 1 - decay**2]) for decay in decays])
    exact = joint_gaussian(data, matrix, noise, [[1, 0]], [[0.25]], (np.zeros(2), np.diag([4.0, 1.0])), 1)
    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["position"], 0.5)))
    return Case(programs, {"y": data}, "velocity", exact, GAUSSIAN, (PARTICLES, EXACT), {"dt": steps})


def meter() -> Case:
    """A rate, and the sum of all that came of it, which is what a meter shows."""

    def initial(inputs: Any) -> None:
        numpyro.sample("rate", dist.Normal(0.0, 1.0))
        numpyro.sample("total", dist.Normal(0.0, 1.0))

    def transition(state: Any, inputs: Any) -> None:
        rate = numpyro.sample("rate", dist.Normal(0.9 * state["rate"], 0.4))
        numpyro.sample("total", dist.Delta(state["total"] + rate))

    data = with_gap(np.cumsum(RNG.normal(size=COUNT)))
    noise = 0.16 * np.ones((2, 2))
    exact = joint_gaussian(data, [[0.9, 0], [0.9, 1]], noise, [[0, 1]], [[0.36]], (np.zeros(2), np.eye(2)), 0)
    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["total"], 0.6)))
    return Case(programs, {"y": data}, "rate", exact, GAUSSIAN, (PARTICLES, EXACT))


def unknown_drift() -> Case:
    """A level with a drift that never changes, carried in the state."""

    def initial(inputs: Any) -> None:
        numpyro.sample("level", dist.Normal(0.0, 1.0))
        numpyro.sample("drift", dist.Normal(0.0, 1.0))

    def transition(state: Any, inputs: Any) -> None:
        numpyro.sample("level", dist.Normal(state["level"] + state["drift"], 0.3))
        numpyro.sample("drift", dist.Delta(state["drift"]))

    data = with_gap(0.5 * np.arange(COUNT) + 0.8 * RNG.normal(size=COUNT))
    noise = np.diag([0.09, 0])
    exact = joint_gaussian(data, [[1, 1], [0, 1]], noise, [[1, 0]], [[0.64]], (np.zeros(2), np.eye(2)), 1)
    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["level"], 0.8)))
    return Case(programs, {"y": data}, "drift", exact, GAUSSIAN, (PARTICLES, EXACT))


def level(observation: Callable[..., Any], data: dict[str, Any], exact: Exact, against: str, *algorithms: Any) -> Case:
    """A random walk that starts at N(0, 1), with steps of 0.5."""
    programs = model(
        lambda inputs: numpyro.sample("x", dist.Normal(0.0, 1.0)),
        lambda state, inputs: numpyro.sample("x", dist.Normal(state["x"], 0.5)),
        observation,
    )
    return Case(programs, data, "x", exact, against, algorithms or (PARTICLES,))


def of_level(data: Any, load: Any, error: Any) -> Exact:
    """The exact answers about it, of linear data."""
    return joint_gaussian(data, [[1.0]], [[0.25]], load, error, (np.zeros(1), np.eye(1)), 0)


def local_level() -> Case:
    """The local level with missing data."""
    data = with_gap(np.cumsum(0.5 * RNG.normal(size=COUNT)))
    observe = lambda state, inputs: numpyro.sample("y", dist.Normal(state["x"], 0.4))  # noqa: E731
    exact = of_level(data, [[1.0]], [[0.16]])
    return level(
        observe, {"y": data}, exact, GAUSSIAN, PARTICLES, EXACT, ("assumed-density", "trajectory"), ("kalman", "laplace")
    )


def chain_of_sensors() -> Case:
    """A sensor that is calibrated against another one of the same frame, which is missing now and then."""

    def observation(state: Any, inputs: Any) -> None:
        first = numpyro.sample("first", dist.Normal(state["x"], 0.5))
        numpyro.sample("second", dist.Normal(first, 0.3))

    data = np.stack([with_gap(RNG.normal(size=COUNT)), RNG.normal(size=COUNT)], 1)
    exact = of_level(data, [[1.0], [1.0]], [[0.25, 0.25], [0.25, 0.34]])
    return level(observation, {"first": data[:, 0], "second": data[:, 1]}, exact, GAUSSIAN, PARTICLES, EXACT)


def shared_offset() -> Case:
    """Two sensors with one offset that nobody sees: a latent site of the observation."""

    def observation(state: Any, inputs: Any) -> None:
        offset = numpyro.sample("offset", dist.Normal(0.0, 0.8))
        numpyro.sample("left", dist.Normal(state["x"] + offset, 0.4))
        numpyro.sample("right", dist.Normal(state["x"] + offset, 0.3))

    data = np.stack([with_gap(RNG.normal(size=COUNT)), RNG.normal(size=COUNT)], 1)
    exact = of_level(data, [[1.0], [1.0]], [[0.8, 0.64], [0.64, 0.73]])
    values = {"offset": np.full(COUNT, np.nan), "left": data[:, 0], "right": data[:, 1]}
    return level(observation, values, exact, GAUSSIAN, PARTICLES, EXACT)


def partly_seen() -> Case:
    """Correlated data of which single entries are missing."""
    covariance = np.array([[0.5, 0.3], [0.3, 0.4]])
    data = RNG.multivariate_normal(np.zeros(2), covariance, COUNT)
    data[[1, 5], 0] = data[[2, 5, 6], 1] = np.nan

    def observation(state: Any, inputs: Any) -> None:
        numpyro.sample("y", dist.MultivariateNormal(state["x"] * jnp.array([1.0, 2.0]), covariance))

    exact = of_level(data, [[1.0], [2.0]], covariance)
    return level(observation, {"y": data}, exact, GAUSSIAN, PARTICLES, EXACT)


def unequal_scales() -> Case:
    """A pressure in pascals and a valve's opening between -1 and 1: standard deviations of 1000 and 0.01."""

    def initial(inputs: Any) -> None:
        numpyro.sample("pressure", dist.Normal(0.0, 1000.0))
        numpyro.sample("opening", dist.Normal(0.0, 0.01))

    def transition(state: Any, inputs: Any) -> None:
        numpyro.sample("pressure", dist.Normal(0.9 * state["pressure"] + 2e4 * state["opening"], 300.0))
        numpyro.sample("opening", dist.Normal(0.95 * state["opening"], 0.003))

    data = with_gap(500 * RNG.normal(size=COUNT))
    matrix, noise = [[0.9, 2e4], [0, 0.95]], np.diag([300.0**2, 0.003**2])
    exact = joint_gaussian(data, matrix, noise, [[1, 0]], [[200.0**2]], (np.zeros(2), np.diag([1e6, 1e-4])), 1)
    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["pressure"], 200.0)))
    return Case(programs, {"y": data}, "opening", exact, GAUSSIAN, (PARTICLES, EXACT))


# Finitely many states


def weather() -> Case:
    """A hidden Markov chain of three values, seen through Gaussians."""
    start, moves = np.array([0.5, 0.3, 0.2]), np.array([[0.8, 0.1, 0.1], [0.2, 0.7, 0.1], [0.3, 0.3, 0.4]])
    data = with_gap(1.5 * RNG.integers(0, 3, COUNT) + RNG.normal(size=COUNT))
    seen = np.nan_to_num(stats.norm.logpdf(data[:, None], 1.5 * np.arange(3)))
    programs = model(
        lambda inputs: numpyro.sample("z", dist.Categorical(jnp.asarray(start))),
        lambda state, inputs: numpyro.sample("z", dist.Categorical(jnp.asarray(moves)[state["z"]])),
        lambda state, inputs: numpyro.sample("y", dist.Normal(1.5 * state["z"], 1.0)),
    )
    exact = markov(np.arange(3), start, moves, seen)
    return Case(programs, {"y": data}, "z", exact, CHAIN, (("hidden-markov", "forward-backward"), PARTICLES))


def outbreak() -> Case:
    """Two regimes with Poisson counts, whose switching depends on an input."""
    season = np.array([0.1, 0.1, 0.4, 0.4, 0.1, 0.1, 0.4, 0.4, 0.1, 0.1])
    data = with_gap(RNG.poisson(np.where(season > 0.2, 9.0, 3.0)))
    moves = np.stack([np.array([[1 - p, p], [0.3, 0.7]]) for p in season])
    seen = np.nan_to_num(stats.poisson.logpmf(data[:, None], [3.0, 9.0]))
    programs = model(
        lambda inputs: numpyro.sample("z", dist.Bernoulli(0.2)),
        lambda state, inputs: numpyro.sample("z", dist.Bernoulli(jnp.where(state["z"] == 1, 0.7, inputs["season"]))),
        lambda state, inputs: numpyro.sample("y", dist.Poisson(3.0 + 6.0 * state["z"])),
    )
    exact = markov(np.arange(2), [0.8, 0.2], moves, seen)
    algorithms = (("hidden-markov", "forward-backward"), PARTICLES)
    return Case(programs, {"y": data}, "z", exact, CHAIN, algorithms, {"season": season})


def survivors() -> Case:
    """A population of 30 of whom each survives a frame with probability 0.9: an integer state with moving bounds."""
    data = np.array([29, 27, 25, np.nan, np.nan, 17, 16, 14, 12, 12.0])
    counts = np.arange(31)
    moves = stats.binom.pmf(counts[None], counts[:, None], 0.9)
    seen = np.nan_to_num(stats.norm.logpdf(data[:, None], counts, 1.5))
    programs = model(
        lambda inputs: numpyro.sample("alive", dist.Binomial(30, 0.95)),
        lambda state, inputs: numpyro.sample("alive", dist.Binomial(state["alive"], 0.9)),
        lambda state, inputs: numpyro.sample("y", dist.Normal(state["alive"], 1.5)),
    )
    exact = markov(counts, stats.binom.pmf(counts, 30, 0.95), moves, seen)
    return Case(programs, {"y": data}, "alive", exact, CHAIN)


def cases_and_sum() -> Case:
    """New cases, and the sum of all cases so far, as one chain of pairs: integers without noise."""
    data = np.array([2, 4, 7, np.nan, np.nan, 15, 17, 20, 22, 26.0])
    new, total = (each.ravel() for each in np.meshgrid(np.arange(12), np.arange(60), indexing="ij"))
    shares = stats.poisson.pmf(np.arange(12)[None], 2.0)[0]
    moves = np.zeros((len(new), len(new)))
    place = {(a, b): index for index, (a, b) in enumerate(zip(new, total, strict=True))}
    for index, before in enumerate(total):
        for cases, share in enumerate(shares):
            moves[index, place[cases, min(before + cases, 59)]] += share
    start = np.where(new == total, np.append(shares, 0)[np.minimum(new, 12)], 0.0)
    seen = np.nan_to_num(stats.norm.logpdf(data[:, None], total, 1.0))

    def initial(inputs: Any) -> None:
        cases = numpyro.sample("cases", dist.Poisson(2.0))
        numpyro.sample("total", dist.Delta(cases))

    def transition(state: Any, inputs: Any) -> None:
        cases = numpyro.sample("cases", dist.Poisson(2.0))
        numpyro.sample("total", dist.Delta(state["total"] + cases))

    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["total"], 1.0)))
    return Case(programs, {"y": data}, "cases", markov(new, start, moves, seen), CHAIN)


def switching() -> Case:
    """A level with calm and wild steps: finite values, and a Gaussian given them, on a grid of both."""
    grid = np.linspace(-8, 8, 401)
    data = with_gap(np.cumsum(np.where(np.arange(COUNT) == 5, 3.0, 0.2) * RNG.normal(size=COUNT)))
    switch, scales = np.array([[0.9, 0.1], [0.5, 0.5]]), np.array([0.3, 1.5])
    steps = np.exp(stats.norm.logpdf(grid[None, None], grid[None, :, None], scales[:, None, None]))
    steps /= steps.sum(-1, keepdims=True)
    moves = np.einsum("ab,bij->aibj", switch, steps).reshape(802, 802)
    first = np.outer([0.8, 0.2], stats.norm.pdf(grid)).ravel()
    seen = np.nan_to_num(stats.norm.logpdf(data[:, None], np.tile(grid, 2), 0.5))

    def initial(inputs: Any) -> None:
        numpyro.sample("wild", dist.Bernoulli(0.2))
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(state: Any, inputs: Any) -> None:
        wild = numpyro.sample("wild", dist.Bernoulli(jnp.where(state["wild"] == 1, 0.5, 0.1)))
        numpyro.sample("x", dist.Normal(state["x"], jnp.where(wild == 1, 1.5, 0.3)))

    programs = model(initial, transition, lambda state, inputs: numpyro.sample("y", dist.Normal(state["x"], 0.5)))
    exact = markov(np.tile(grid, 2), first, moves, seen)
    return Case(programs, {"y": data}, "x", exact, GRID.format(802), (PARTICLES, ("rao-blackwellised", "backward-simulation")))


# One real state, on a grid


def walk_on_grid(log_likelihood: Callable[..., Any], data: Any, low: float = -7.0, high: float = 7.0) -> Exact:
    """The level of :func:`level` with other data; frames without any say nothing."""
    values = np.asarray(data, float)

    def seen(frame: int, grid: Array) -> Array:
        if np.isnan(values[frame]):
            return np.zeros_like(grid)
        return np.asarray(log_likelihood(values[frame], grid))

    walk = lambda new, old: stats.norm.logpdf(new, old, 0.5)  # noqa: E731
    return on_grid(low, high, stats.norm.logpdf, walk, seen)


def on_walk(
    observe: Callable[[Any], dist.Distribution], log_likelihood: Callable[..., Any], data: Any, *algorithms: Any
) -> Case:
    """A case of :func:`level` on a grid."""
    observation = lambda state, inputs: numpyro.sample("y", observe(state["x"]))  # noqa: E731
    exact = walk_on_grid(log_likelihood, data)
    return level(observation, {"y": data}, exact, GRID.format(1201), *algorithms)


def counts() -> Case:
    """Poisson counts."""
    data = with_gap(RNG.poisson(np.exp(1 + 0.5 * np.sin(np.arange(COUNT)))))
    mass = lambda value, x: stats.poisson.logpmf(value, np.exp(1 + x))  # noqa: E731
    return on_walk(lambda x: dist.Poisson(jnp.exp(1 + x)), mass, data, PARTICLES, ("assumed-density", "trajectory"))


def dispersed_counts() -> Case:
    """Negative binomial counts, of mean exp(1 + x) and concentration 3."""
    data = with_gap(RNG.negative_binomial(3, 0.4, COUNT))
    mass = lambda value, x: stats.nbinom.logpmf(value, 3, 3 / (3 + np.exp(1 + x)))  # noqa: E731
    return on_walk(lambda x: dist.NegativeBinomial2(jnp.exp(1 + x), 3.0), mass, data)


def shares() -> Case:
    """Successes of 40 trials."""
    data = with_gap(RNG.binomial(40, 0.4, COUNT))
    mass = lambda value, x: stats.binom.logpmf(value, 40, special.expit(x))  # noqa: E731
    return on_walk(lambda x: dist.Binomial(40, logits=x), mass, data, PARTICLES, ("tempered", "backward-simulation"))


def volatility() -> Case:
    """Stochastic volatility."""
    data = with_gap(RNG.normal(size=COUNT) * np.exp(0.5 * np.sin(np.arange(COUNT))))
    density = lambda value, x: stats.norm.logpdf(value, 0, np.exp(x / 2))  # noqa: E731
    return on_walk(lambda x: dist.Normal(0.0, jnp.exp(x / 2)), density, data)


def outliers() -> Case:
    """Errors of Student's t with two degrees of freedom, and one value far off."""
    data = with_gap(np.where(np.arange(COUNT) == 6, 9.0, 0.4 * RNG.normal(size=COUNT)))
    density = lambda value, x: stats.t.logpdf(value, 2, x, 0.4)  # noqa: E731
    return on_walk(lambda x: dist.StudentT(2.0, x, 0.4), density, data)


def two_signs() -> Case:
    """The square of the level: two modes."""
    data = with_gap((1 + 0.3 * np.arange(COUNT)) ** 2 / 2)
    density = lambda value, x: stats.norm.logpdf(value, x**2, 0.8)  # noqa: E731
    return on_walk(lambda x: dist.Normal(x**2, 0.8), density, data)


def large_counts() -> Case:
    """Counts of a million."""
    base = float(np.log(1e6))
    data = np.array([1_000_000, 1_002_000, 1_001_000, np.nan, np.nan, 1_004_000, 1_003_000, 1_003_500, 1_002_000, 1_001_500])

    def seen(frame: int, grid: Array) -> Array:
        return np.zeros_like(grid) if np.isnan(data[frame]) else stats.poisson.logpmf(data[frame], np.exp(grid))

    programs = model(
        lambda inputs: numpyro.sample("x", dist.Normal(base, 0.01)),
        lambda state, inputs: numpyro.sample("x", dist.Normal(state["x"], 0.002)),
        lambda state, inputs: numpyro.sample("y", dist.Poisson(jnp.exp(state["x"]))),
    )
    exact = on_grid(
        base - 0.03,
        base + 0.03,
        lambda x: stats.norm.logpdf(x, base, 0.01),
        lambda new, old: stats.norm.logpdf(new, old, 0.002),
        seen,
        size=2401,
    )
    return Case(programs, {"y": data}, "x", exact, GRID.format(2401))


def positive() -> Case:
    """A positive level in steps of its logarithm, seen with Gamma errors; the grid is one of the logarithm."""
    data = with_gap(RNG.gamma(4.0, 0.5, COUNT))
    grid = np.linspace(-4, 4, 1201)
    seen = np.stack(
        [np.zeros_like(grid) if np.isnan(value) else stats.gamma.logpdf(value, 4.0, scale=np.exp(grid) / 4) for value in data]
    )
    moves = np.exp(stats.norm.logpdf(grid[None], grid[:, None], 0.3))
    exact = markov(np.exp(grid), stats.norm.pdf(grid, 0, 0.5), moves, seen)
    programs = model(
        lambda inputs: numpyro.sample("rate", dist.LogNormal(0.0, 0.5)),
        lambda state, inputs: numpyro.sample("rate", dist.LogNormal(jnp.log(state["rate"]), 0.3)),
        lambda state, inputs: numpyro.sample("y", dist.Gamma(4.0, 4.0 / state["rate"])),
    )
    return Case(programs, {"y": data}, "rate", exact, GRID.format(1201), (PARTICLES, ("tempered", "backward-simulation")))


def growth() -> Case:
    """The growth model of Gordon, Salmond and Smith: a bent transition with an input, and data of the square."""
    times = np.arange(COUNT, dtype=float)
    data = with_gap(RNG.gamma(2.0, 3.0, COUNT))
    grid = np.linspace(-35, 35, 1401)
    means = np.stack([grid / 2 + 25 * grid / (1 + grid**2) + 8 * np.cos(1.2 * time) for time in times])
    moves = np.exp(stats.norm.logpdf(grid[None, None], means[:, :, None], np.sqrt(10)))
    seen = np.stack([np.zeros_like(grid) if np.isnan(value) else stats.norm.logpdf(value, grid**2 / 20, 1.0) for value in data])

    def transition(state: Any, inputs: Any) -> None:
        x = state["x"]
        numpyro.sample("x", dist.Normal(x / 2 + 25 * x / (1 + x**2) + 8 * jnp.cos(1.2 * inputs["time"]), jnp.sqrt(10.0)))

    programs = model(
        lambda inputs: numpyro.sample("x", dist.Normal(0.0, 2.0)),
        transition,
        lambda state, inputs: numpyro.sample("y", dist.Normal(state["x"] ** 2 / 20, 1.0)),
    )
    exact = markov(grid, stats.norm.pdf(grid, 0, 2), moves, seen)
    return Case(programs, {"y": data}, "x", exact, GRID.format(1401), (PARTICLES,), {"time": times})


CASES: dict[str, Callable[[], Case]] = {
    "AR(2) with its lag in the state": lag,
    "velocity and its integral, uneven times": integrated,
    "rate and its running total": meter,
    "constant drift in the state": unknown_drift,
    "local level, missing data": local_level,
    "sensor read against another one": chain_of_sensors,
    "latent offset of two sensors": shared_offset,
    "correlated data, entries missing": partly_seen,
    "scales of 1000 and 0.01": unequal_scales,
    "hidden Markov chain, Gaussian data": weather,
    "hidden Markov chain, counts and an input": outbreak,
    "binomial survival, integer state": survivors,
    "Poisson cases and their running total": cases_and_sum,
    "steps that switch between two scales": switching,
    "Poisson counts": counts,
    "negative binomial counts": dispersed_counts,
    "binomial shares": shares,
    "stochastic volatility": volatility,
    "Student-t errors, one outlier": outliers,
    "square of the level, two modes": two_signs,
    "Poisson counts of a million": large_counts,
    "positive level, Gamma errors": positive,
    "growth model": growth,
}
