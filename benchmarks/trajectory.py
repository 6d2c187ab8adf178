"""Whole-trajectory NUTS on the 28-DOF body: effective draws a second, beside NumPyro's NUTS on the same model with its scan.

    python -m benchmarks.trajectory [--quick] [--frames 100] [--draws 250] [--warmup 250] [--chains 4] [--alone]

The body walks the built-in gait before one camera at 5 m. Ours starts from the history of the default tracker, and NumPyro's
from trajectories drawn from it. Particle-mGRAD makes ten moves for each of the others' draws; --alone compares it with our NUTS
only. Effective sample sizes are ArviZ's over all frames and coordinates; the time is that of warm-up and draws, compilation
apart. A gradient is that of the whole trajectory, for one chain.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from arviz_stats.base import array_stats
from numpyro.contrib.control_flow import scan
from numpyro.infer import NUTS

from benchmarks.timing import arguments, show
from poseppl.filters import assumed_density_filter
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import paper_camera
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import Problem, make_problem, observe_motion
from poseppl.runs.frame_sequence import frame_inputs
from poseppl.runs.run import run_filter
from poseppl.smoothers import History, Smoother, collect_history, particle_mgrad_smoother, trajectory_smoother
from poseppl.smoothers.backward_pass import initial_trajectories

MOVES = 10
"""Moves of Particle-mGRAD, which cost less each, for one draw of the others."""
OURS, MGRAD, RIVAL = "poseppl, NUTS", "poseppl, Particle-mGRAD", "NumPyro, NUTS with its scan"


class Sampled(NamedTuple):
    """Draws (chain, draw, T, d), gradients of a trajectory for each draw and chain, warm-up included, and seconds.

    `cpu_seconds` are those of all threads of the process, which a busy machine does not stretch.
    """

    draws: np.ndarray
    gradients: float
    compile_seconds: float
    seconds: float
    cpu_seconds: float


def build(num_frames: int) -> Problem:
    """The walk as one camera sees it."""
    scene = observe_motion(walking_subject(frames=f"0:{num_frames}"), paper_camera((0.0, -5000.0, 1000.0)), ["front"])
    return make_problem(scene)


def compiled(function: Callable[..., Any], *given: Any) -> tuple[Any, float, float, float]:
    """Run a function; return its value, its seconds to compile, and those to run by the clock and by the processors."""
    started = time.perf_counter()
    ready = jax.jit(function).lower(*given).compile()
    between, busy = time.perf_counter(), time.process_time()
    result = jax.block_until_ready(ready(*given))
    return result, between - started, time.perf_counter() - between, time.process_time() - busy


def ours(problem: Problem, history: History, inputs: Any, smoother: Smoother, moves: int) -> Sampled:
    """A smoother of this project, of so many updates of each chain, warm-up included."""
    smoothed, *seconds = compiled(smoother.smooth, jax.random.key(1), history, problem.observations, inputs)
    num_frames, chains = smoothed.particles.shape[:2]
    gradients = float(smoothed.info.num_gradient) / (num_frames * chains * moves)
    return Sampled(np.moveaxis(np.asarray(smoothed.particles), 0, 2), gradients, *seconds)


def numpyro_model(problem: Problem, inputs: BodyInputs) -> Callable[[jax.Array], None]:
    """The same model with NumPyro's scan over the frames."""
    tree = problem.body.tree

    def model(points: jax.Array) -> None:
        def see(x: jax.Array, seen: jax.Array) -> None:
            numpyro.sample("points", ProjectedMarkers(tree, inputs.cameras, x, inputs.noise).to_event(3), obs=seen)

        def step(x: jax.Array, seen: jax.Array) -> tuple[jax.Array, None]:
            x = numpyro.sample("x", dist.Normal(x, inputs.step_scale).to_event(1))
            see(x, seen)
            return x, None

        first = numpyro.sample("first", dist.Normal(inputs.start, inputs.start_scale).to_event(1))
        with numpyro.handlers.scope(prefix="at_first"):
            see(first, points[0])
        scan(step, first, points[1:])

    return model


def rival(problem: Problem, one: BodyInputs, starts: jax.Array, draws: int, warmup: int) -> Sampled:
    """NumPyro's kernel in one compiled loop, which spares it the class around it; it adapts a diagonal mass matrix."""
    points = problem.observations.values["points"]
    kernel = NUTS(numpyro_model(problem, one))
    keys = jax.random.split(jax.random.PRNGKey(2), starts.shape[0])
    first = {"first": starts[:, 0], "x": starts[:, 1:]}
    state = kernel.init(keys, warmup, first, (points,), {})

    def run(state: Any) -> Any:
        def update(state: Any, _: None) -> tuple[Any, Any]:
            state = kernel.sample(state, (points,), {})
            return state, (state.z, state.num_steps)

        return jax.lax.scan(update, state, None, length=warmup + draws)[1]

    (places, steps), *seconds = compiled(run, state)
    whole = np.concatenate([np.asarray(places["first"])[:, :, None], np.asarray(places["x"])], 2)
    return Sampled(np.swapaxes(whole[warmup:], 0, 1), float(np.mean(steps)), *seconds)


def effective(draws: np.ndarray) -> np.ndarray:
    """ArviZ's effective sample size of each frame and coordinate."""
    values = draws.reshape(*draws.shape[:2], -1).astype(float)
    return np.array([array_stats.ess(values[:, :, i], chain_axis=0, draw_axis=1) for i in range(values.shape[2])])


def main() -> None:
    options = arguments(__doc__, frames=100, draws=250, warmup=250, chains=4, alone=False)
    frames, draws, warmup = (5, 20, 20) if options.quick else (options.frames, options.draws, options.warmup)
    problem = build(frames)
    tracker = assumed_density_filter(problem.model)
    tracked = run_filter(
        tracker, jax.random.key(0), problem.observations, problem.inputs, num_frames=frames, collect=collect_history
    )
    history = History(*jax.tree.map(jnp.asarray, tracked.outputs))
    one = frame_inputs(problem.inputs, 0)
    inputs = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (frames, *leaf.shape)), one)
    length, chains = {"num_draws": draws, "num_warmup": warmup}, options.chains
    longer = {name: MOVES * many for name, many in length.items()}

    def run(smoother: Smoother, moves: int) -> Sampled:
        return ours(problem, history, inputs, smoother, moves)

    results = {
        OURS: run(trajectory_smoother(problem.model, num_chains=chains, **length), draws + warmup),
        MGRAD: run(particle_mgrad_smoother(problem.model, num_chains=chains, **longer), MOVES * (draws + warmup)),
    }
    if not options.alone:
        hmc = trajectory_smoother(problem.model, num_chains=chains, kernel="hmc", **length)
        pick = jax.jit(lambda key: initial_trajectories(problem.model, key, history, inputs, chains))
        results["poseppl, HMC"] = run(hmc, draws + warmup)
        results[RIVAL] = rival(problem, one, pick(jax.random.key(3)), draws, warmup)
    report(results, f"{frames} frames, {options.chains} chains of {draws} draws after {warmup}")


def report(results: Mapping[str, Sampled], title: str) -> None:
    """Print effective sample sizes and rates, NUTS here over NumPyro's, and Particle-mGRAD over NUTS."""
    rows, rates = [], {}
    for name, sampled in results.items():
        ess = effective(sampled.draws)
        both = np.array([ess.min(), np.median(ess)])
        rates[name] = both / sampled.seconds, both / sampled.cpu_seconds
        figures = [sampled.seconds, sampled.cpu_seconds, sampled.compile_seconds, sampled.gradients, *both, *rates[name][0]]
        rows.append([name, *(f"{figure:.3g}" for figure in figures)])
    show(title, ["", "s", "CPU s", "compile s", "gradients a draw", "ESS min", "median", "min/s", "median/s"], rows)
    for better, other in ((OURS, RIVAL), (MGRAD, OURS)):
        for clock, unit in enumerate(("second", "CPU second") if other in rates else ()):
            least, median = rates[better][clock] / rates[other][clock]
            print(f"Effective draws a {unit}: {better} has {least:.2f} (worst), {median:.2f} (median) times {other}; goal: 5.")


if __name__ == "__main__":
    main()
