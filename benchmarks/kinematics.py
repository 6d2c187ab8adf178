"""Marker likelihoods and gradients a second, against 3x3 products, MuJoCo and MJX on the same tree in the same run.

    python -m benchmarks.kinematics [--quick] [--mjx]

A likelihood is that of 17 markers of the 28-DOF body in one camera, float32. Gradients are those of a scan of leapfrog steps,
as a tracker takes them. MuJoCo (`pip install mujoco`) does the kinematics alone, on one core, called from Python; MJX (`pip
install mujoco-mjx`, asked for by --mjx, for it compiles a minute) the kinematics under vmap. Libraries that are not installed
are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.choo_fleet import full_body

from benchmarks.plain_kinematics import MJX, MuJoCo, plain_log_density
from benchmarks.timing import arguments, interleave, show
from poseppl.motion.geometry import marker_positions, paper_camera
from poseppl.motion.likelihoods import ProjectedMarkers

CENTRE = (0.0, -5000.0, 1000.0)
NOISE = 0.003


def report_likelihoods(count: int, repetitions: int, with_mjx: bool) -> None:
    """The likelihood alone, many particles at once."""
    tree, states, points = problem(count)
    ours = jax.jit(jax.vmap(fast_log_density(tree, points)))
    plain = jax.jit(jax.vmap(plain_log_density(tree, CENTRE, points, NOISE)))
    rivals: dict[str, tuple[int, Callable[[], Any]]] = {
        "poseppl": (count, lambda: ours(states)),
        "plain 3x3 products": (count, lambda: plain(states)),
    }
    few = min(count, 10_000)
    expected = np.asarray(jax.vmap(lambda x: marker_positions(tree, x))(states[:5]))
    try:
        mujoco = MuJoCo(tree)
        found = np.stack([mujoco.markers(np.asarray(state)) for state in states[:5]])
        np.testing.assert_allclose(found, expected, atol=0.01)
        rows = np.asarray(states[:few], np.float64)[:, mujoco.order]
        rivals["MuJoCo mj_kinematics, 1 core"] = (few, lambda: mujoco.run(rows))
        if with_mjx:
            kinematics = jax.jit(jax.vmap(MJX(tree).markers))
            rivals["MJX kinematics"] = (few, lambda: kinematics(states[:few]))
    except ImportError as error:
        print(f"Left out: {error}")
    seconds = interleave({name: run for name, (_, run) in rivals.items()}, repetitions)
    if "MJX kinematics" in rivals:
        np.testing.assert_allclose(rivals["MJX kinematics"][1]()[:5], expected, atol=0.05)
    rates = {name: number / seconds[name].median for name, (number, _) in rivals.items()}
    constant = 2 * len(points) * (np.log(NOISE) + 0.5 * np.log(2 * np.pi))
    np.testing.assert_allclose(ours(states)[:100] + constant, plain(states)[:100], rtol=1e-2, atol=1.0)
    show(
        f"Marker likelihoods, N = {count:,}",
        ["", "million a second", "poseppl is faster by", "first call s"],
        [
            [name, f"{rate / 1e6:.3f}", f"{rates['poseppl'] / rate:.1f}", f"{seconds[name].first:.1f}"]
            for name, rate in rates.items()
        ],
    )
    report_limit(ours, states, rates["poseppl"])


def report_limit(likelihood: Any, states: jax.Array, rate: float) -> None:
    """How much arithmetic and memory traffic the rate amounts to, beside a matrix product and a copy on the same cores."""
    flops = likelihood.lower(states).compile().cost_analysis()["flops"] / len(states)
    square = jnp.ones((1500, 1500), jnp.float32)
    large = jnp.ones(2**26, jnp.float32)
    product, double = jax.jit(jnp.matmul), jax.jit(lambda x: 2 * x)
    seconds = interleave({"product": lambda: product(square, square), "copy": lambda: double(large)}, 5)
    peak = 2 * square.shape[0] ** 3 / seconds["product"].median
    bandwidth = 8 * large.size / seconds["copy"].median
    used = 4 * (states.shape[1] + 1) * rate
    print(
        f"A likelihood is {flops:.0f} operations on {4 * states.shape[1]} bytes. {rate * flops / 1e9:.0f} GFLOP/s are "
        f"{rate * flops / peak:.0%} of what a matrix product reaches here, {used / 1e9:.1f} GB/s are {used / bandwidth:.0%} "
        "of what a copy does."
    )


def report_gradients(count: int, steps: int, repetitions: int) -> None:
    """Value and gradient inside a scan, for a number of chains."""
    tree, states, points = problem(count)
    densities = {
        "poseppl": fast_log_density(tree, points),
        "plain 3x3 products, autodiff": plain_log_density(tree, CENTRE, points, NOISE),
    }
    found, expected = (jax.vmap(jax.grad(density))(states[:5]) for density in densities.values())
    np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-3 * float(jnp.abs(expected).max()))
    scans = {name: leapfrog(density, steps) for name, density in densities.items()}
    seconds = interleave({name: lambda run=run: run(states) for name, run in scans.items()}, repetitions)
    rates = {name: count * steps / timing.median for name, timing in seconds.items()}
    show(
        f"Gradients in a scan, {count} chains",
        ["", "thousand a second", "µs a step", "poseppl is faster by", "first call s"],
        [
            [
                name,
                f"{rate / 1e3:.0f}",
                f"{1e6 * count / rate:.1f}",
                f"{rates['poseppl'] / rate:.1f}",
                f"{seconds[name].first:.1f}",
            ]
            for name, rate in rates.items()
        ],
    )


def leapfrog(density: Callable[[jax.Array], jax.Array], steps: int) -> Callable[[jax.Array], Any]:
    """Leapfrog steps so short that nothing leaves its place."""
    gradient = jax.vmap(jax.value_and_grad(density))

    def run(states: jax.Array) -> Any:
        def step(carry: Any, _: None) -> tuple[Any, jax.Array]:
            state, momentum, force = carry
            momentum = momentum + 0.5e-6 * force
            state = state + 1e-6 * momentum
            value, force = gradient(state)
            return (state, momentum + 0.5e-6 * force, force), value

        return jax.lax.scan(step, (states, 0 * states, 0 * states), None, length=steps)

    return jax.jit(run)


def fast_log_density(tree: Any, points: jax.Array) -> Callable[[jax.Array], jax.Array]:
    camera = paper_camera(CENTRE)
    return lambda state: ProjectedMarkers(tree, camera, state, NOISE).summed_log_prob(points[None], None)


def problem(count: int) -> tuple[Any, jax.Array, jax.Array]:
    """The tree, states (count, 28) around rest, and the image points (17, 2) of the rest pose."""
    body = full_body()
    scale = np.r_[np.full(3, 15.0), np.full(body.tree.dimension - 3, 0.15)]
    states = body.rest + np.random.default_rng(0).normal(size=(count, body.tree.dimension)) * scale
    place = marker_positions(body.tree, jnp.asarray(body.rest, jnp.float32)) - jnp.array(CENTRE)
    return body.tree, jnp.asarray(states, jnp.float32), place[:, ::2] / place[:, 1:2]


def main() -> None:
    options = arguments(__doc__, mjx=False)
    quick = options.quick
    report_likelihoods(5_000 if quick else 100_000, 2 if quick else 9, options.mjx)
    for count, steps in ((10, 2000), (30, 1000), (200, 200)):
        report_gradients(count, steps // 20 if quick else steps, 2 if quick else 9)


if __name__ == "__main__":
    main()
