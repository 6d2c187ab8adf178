"""Which filters and smoothers keep two mirror modes through a long ambiguous stretch, against the exact answer.

    python -m studies.mirror_modes [--quick] [--runs 40] [--frames 40] [--methods assumed,Kalman]

Every run draws its own data of `poseppl_models.toys.mirror`. The side of the state is observed at the first frame, at the last,
or never. A filter gives the probability of the positive side at the last frame but one, a smoother in the middle; a quadrature
grid gives the exact value. Both modes are kept if the lesser one has at least a quarter of its exact probability; this is
counted where that is a tenth or more. The error is the root mean square error of the probability over runs. Smoothers take the
history of a bootstrap filter with N = 1,000. A single Gaussian across 0 counts as both modes; the Kalman filters show this.
`--methods` selects methods by words in their names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.mirror import NOISE, SPREAD, START, mirror, mirror_mean

from benchmarks.timing import arguments, show
from poseppl.filters import (
    Filter,
    annealed_filter,
    assumed_density_filter,
    covariance_scaled_filter,
    demc_filter,
    guided_filter,
    hmc_filter,
    kalman_filter,
    particle_filter,
    tempered_filter,
)
from poseppl.filters.scan import scan_filter
from poseppl.kernels import HMCSettings
from poseppl.program import CompiledModel, Observation
from poseppl.runs.simulation import simulate
from poseppl.smoothers import (
    History,
    MixtureSettings,
    Smoother,
    backward_simulation_smoother,
    forward_backward_smoother,
    genealogy_smoother,
    gibbs_smoother,
    mixture_variational_smoother,
    particle_gibbs_smoother,
    trajectory_smoother,
    viterbi_smoother,
)

FILTERS: Mapping[str, Callable[[CompiledModel], Filter]] = {
    "particle, N 100": lambda model: particle_filter(model, 100),
    "particle, N 1,000": lambda model: particle_filter(model, 1000),
    "guided, N 100": lambda model: guided_filter(model, 100),
    "tempered, N 100": lambda model: tempered_filter(model, 100),
    "tempered, mixture, N 100": lambda model: tempered_filter(model, 100, target="mixture"),
    "annealed, N 100, 10 layers": lambda model: annealed_filter(model, 100),
    "DE-MC, likelihood, N 100": lambda model: demc_filter(model, 100),
    "DE-MC, posterior, N 100": lambda model: demc_filter(model, 100, target="posterior"),
    "HMC, 10 chains": lambda model: hmc_filter(model, 10, HMCSettings(num_updates=32, num_leapfrog=8, num_warmup=6)),
    "assumed density, 1 Gaussian": lambda model: assumed_density_filter(model, num_components=1),
    "assumed density, 2 Gaussians": lambda model: assumed_density_filter(model, num_components=2),
    "assumed density, 3 Gaussians": assumed_density_filter,
    "covariance scaled, 3 modes": lambda model: covariance_scaled_filter(model, num_modes=3, num_starts=12),
    "multiple hypotheses, 3 modes": lambda model: covariance_scaled_filter(
        model, num_modes=3, num_starts=12, sampling="hypotheses"
    ),
    "covariance scaled, 1 mode": lambda model: covariance_scaled_filter(model, num_modes=1, num_starts=1),
    "extended Kalman": lambda model: kalman_filter(model, 1000),
    "unscented Kalman": lambda model: kalman_filter(model, 1000, linearisation="unscented"),
}

SMOOTHERS: Mapping[str, Callable[[CompiledModel], Smoother]] = {
    "genealogy": genealogy_smoother,
    "forward-backward": forward_backward_smoother,
    "backward simulation": lambda model: backward_simulation_smoother(model, 500),
    "Viterbi": viterbi_smoother,
    "variational, K 50": mixture_variational_smoother,
    "variational, factorised": lambda model: mixture_variational_smoother(model, factorised=True),
    "Gibbs, not divided": lambda model: gibbs_smoother(
        model, collapsed=False, num_chains=1, num_draws=1900, num_warmup=100, mixture=MixtureSettings(correction="none")
    ),
    "Gibbs, density corrected, 1 chain": lambda model: gibbs_smoother(model, num_chains=1, num_draws=1900, num_warmup=100),
    "Gibbs, density corrected, 20 chains": lambda model: gibbs_smoother(model, num_chains=20, num_draws=95, num_warmup=5),
    "Gibbs on the model, 20 chains": lambda model: gibbs_smoother(
        model, num_chains=20, num_draws=95, num_warmup=5, target="model"
    ),
    "particle Gibbs, ancestor sampling": lambda model: particle_gibbs_smoother(model),
    "particle Gibbs, backward": lambda model: particle_gibbs_smoother(model, method="backward"),
    "trajectory NUTS, 4 chains": lambda model: trajectory_smoother(model),
    "trajectory NUTS, 20 chains": lambda model: trajectory_smoother(model, num_chains=20, num_draws=50),
}

TOLD = ("first", "last", "never")


class Data(NamedTuple):
    """Data of R runs of T frames, with each run's true states (R, T)."""

    observations: Observation
    states: np.ndarray[Any, Any]


def draw_data(model: CompiledModel, num_runs: int, num_frames: int, seen_at: str) -> Data:
    """Simulate; the side is masked where it is not observed."""
    drawn = [simulate(model, jax.random.key(run), num_frames) for run in range(num_runs)]
    seen = np.zeros(num_frames, bool)
    seen[0], seen[-1] = seen_at == "first", seen_at == "last"
    values = {name: np.stack([run.values[name] for run in drawn]) for name in ("y", "side")}
    values["side"] = np.where(seen, values["side"], 0.0)
    mask = {"y": np.ones((num_runs, num_frames), bool), "side": np.broadcast_to(seen, (num_runs, num_frames))}
    states = np.stack([run.states[:, 0] for run in drawn])
    return Data(Observation(jax.tree.map(jnp.asarray, values), jax.tree.map(jnp.asarray, mask)), states)


def exact_positive(data: Data) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """P(x_t > 0) filtered and smoothed, each (R, T), by quadrature over x."""
    grid = np.linspace(-9.0, 9.0, 600)  # 0 is between two points

    def normal(residual: Any, scale: float) -> Any:
        return np.exp(-0.5 * (residual / scale) ** 2)

    kernel = normal(grid[:, None] - np.asarray(mirror_mean(grid), float)[None], SPREAD)
    kernel /= kernel.sum(0)
    values, mask = jax.tree.map(np.asarray, data.observations)
    likelihood = normal(values["y"][..., None] - np.abs(grid), NOISE)
    likelihood *= np.where(mask["side"][..., None], normal(values["side"][..., None] - grid, NOISE), 1.0)
    forward = [normal(grid, START) * likelihood[:, 0]]
    for t in range(1, likelihood.shape[1]):
        forward.append(_normalised(forward[-1]) @ kernel.T * likelihood[:, t])
    backward = [np.ones_like(forward[0])]
    for t in range(likelihood.shape[1] - 1, 0, -1):
        backward.append(_normalised(likelihood[:, t] * backward[-1]) @ kernel)
    filtered, back = np.stack(forward, 1), np.stack(backward[::-1], 1)
    return tuple(_normalised(density)[..., grid > 0].sum(-1) for density in (filtered, filtered * back))  # type: ignore[return-value]


def _normalised(density: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return density / density.sum(-1, keepdims=True)


def positive(particles: jax.Array, log_weights: jax.Array) -> jax.Array:
    """P(x > 0) of one frame."""
    return jax.nn.softmax(log_weights.ravel()) @ (particles.ravel() > 0)


def run_filter(built: Filter, rng_key: jax.Array, observations: Observation) -> tuple[jax.Array, History]:
    """P(x_t > 0) (T,), and the history."""

    def keep(rng_key: jax.Array, state: Any, info: Any, inputs: Any) -> Any:
        particles = state.particles.reshape(-1, 1)
        log_weights = jax.nn.log_softmax(state.log_weights.ravel())
        return positive(particles, log_weights), History(particles, log_weights, info.ancestors, info.failed)

    both: tuple[jax.Array, History] = scan_filter(built, rng_key, observations, collect=keep).outputs
    return both


def probabilities(model: CompiledModel, name: str) -> Callable[[Observation], np.ndarray[Any, Any]]:
    """P(x_t > 0) (R, T) as a method finds it, from the stacked data of the runs."""
    built = FILTERS[name](model) if name in FILTERS else particle_filter(model, 1000)
    smoother = None if name in FILTERS else SMOOTHERS[name](model)

    def one(row: tuple[jax.Array, Observation]) -> jax.Array:
        key_filter, key_smooth = jax.random.split(row[0])
        found, history = run_filter(built, key_filter, row[1])
        if smoother is None:
            return found
        smoothed = smoother.smooth(key_smooth, history, row[1], None)
        return jax.vmap(positive)(smoothed.particles, smoothed.log_weights)

    run = jax.jit(lambda keys, observations: jax.lax.map(one, (keys, observations)))

    def find(observations: Observation) -> np.ndarray[Any, Any]:
        keys = jax.random.split(jax.random.key(1), observations.values["y"].shape[0])
        return np.asarray(run(keys, observations), float)

    return find


def cell(found: np.ndarray[Any, Any], exact: np.ndarray[Any, Any]) -> str:
    """Share of runs that keep both modes, where there are two, and the root mean square error."""
    lesser = np.where(exact < 0.5, exact, 1 - exact)
    kept = np.where(exact < 0.5, found, 1 - found) >= lesser / 4
    kept &= np.where(exact < 0.5, 1 - found, found) >= lesser / 4
    two = lesser >= 0.1
    share = f"{100 * kept[two].mean():3.0f} %" if two.any() else "    -"
    return f"{share}  {np.sqrt(((found - exact) ** 2).mean()):.3f}"


def report(methods: Sequence[str], model: CompiledModel, num_runs: int, num_frames: int, *, smoothers: bool) -> None:
    """Print one table."""
    # what the last frame tells comes too late for a filter
    place, tellings = (num_frames // 2, TOLD) if smoothers else (num_frames - 2, ("first", "never"))
    data = {seen_at: draw_data(model, num_runs, num_frames, seen_at) for seen_at in tellings}
    exact = {seen_at: exact_positive(data[seen_at])[int(smoothers)][:, place] for seen_at in tellings}
    rows = []
    for name in methods:
        find = probabilities(model, name)
        rows.append([name, *(cell(find(data[seen_at].observations)[:, place], exact[seen_at]) for seen_at in tellings)])
        jax.clear_caches()
    truth = ["two modes in the exact answer"]
    truth += [f"{100 * np.mean(np.minimum(exact[seen_at], 1 - exact[seen_at]) >= 0.1):3.0f} %" for seen_at in tellings]
    kind = "Smoothers, in the middle" if smoothers else "Filters, at the last frame but one"
    title = f"{kind}: both modes kept, and error of P(x > 0), by when the side is told; {num_runs} runs, T = {num_frames}"
    show(title, ["", *tellings], [truth, *rows])


def main() -> None:
    options = arguments(__doc__, runs=40, frames=40, methods="")
    num_runs, num_frames = (2, 6) if options.quick else (options.runs, options.frames)
    model = mirror().compile()
    for methods, smoothers in ((FILTERS, False), (SMOOTHERS, True)):
        asked = [name for name in methods if any(word in name for word in options.methods.split(","))]
        if asked:
            report(asked, model, num_runs, num_frames, smoothers=smoothers)


if __name__ == "__main__":
    main()
