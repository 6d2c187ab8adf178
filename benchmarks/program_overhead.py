"""Cost of writing a model as NumPyro programs: densities and gradients against the same ones by hand.

    python -m benchmarks.program_overhead [--quick]

By hand means one array expression on the flat state. The likelihood is one site; the transition has fourteen sites, one a
joint, which are slices of the flat state. The cost of slicing shows at large N, where the form by hand is limited by memory
alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.simulated import NOISE, SIGMA_ANGLE, SIGMA_POSITION, build_problem, draw_sequence
from benchmarks.timing import arguments, interleave, show
from poseppl.motion.likelihoods import projected_log_density

Density = Callable[[jax.Array], jax.Array]


def densities() -> tuple[jax.Array, dict[str, tuple[Density, Density]]]:
    """The true state (28,) of a frame, and by name a program's density and its form by hand, both of one state."""
    problem = build_problem()
    (before, truth), observations = draw_sequence(problem, 0, 2)
    seen = jax.tree.map(lambda leaf: leaf[1], observations)
    model, inputs = problem.model, problem.inputs
    mask = jnp.ones(seen.values["points"].shape)
    scale = jnp.concatenate([jnp.full(3, SIGMA_POSITION), jnp.full(model.dimension - 3, SIGMA_ANGLE)])

    def likelihood(x: jax.Array) -> jax.Array:
        noise = jnp.full(mask.shape[:-1], NOISE)
        return projected_log_density(problem.body.tree, x, inputs.cameras, noise, seen.values["points"], mask)

    def transition(x: jax.Array) -> jax.Array:
        return jnp.sum(-0.5 * ((x - before) / scale) ** 2 - jnp.log(scale) - 0.5 * jnp.log(2 * jnp.pi))

    pairs = {
        "likelihood": (lambda x: model.log_observation(x, seen, inputs), likelihood),
        "transition": (lambda x: model.log_transition(x, before, inputs), transition),
    }
    return truth, pairs


def repeat(run: Density, states: jax.Array, times: int) -> list[jax.Array]:
    return [run(states) for _ in range(times)]


def main() -> None:
    quick = arguments(__doc__).quick
    truth, pairs = densities()
    rows = []
    for count in (10, 100_000):
        crowd = truth + 0.01 * jnp.asarray(np.random.default_rng(0).normal(size=(count, len(truth))), jnp.float32)
        many = 1 if count > 1000 or quick else 100
        for name, pair in pairs.items():
            for what, form in (("value", lambda f: f), ("gradient", jax.grad)):
                runs = [jax.jit(jax.vmap(form(density))) for density in pair]
                np.testing.assert_allclose(*(run(crowd[:10]) for run in runs), rtol=1e-3, atol=0.1)
                rivals = {side: partial(repeat, run, crowd, many) for side, run in zip(("program", "hand"), runs, strict=True)}
                seconds = interleave(rivals, 2 if quick else 15)
                ratio = seconds["program"].median / seconds["hand"].median
                times = (f"{1e6 * seconds[side].median / many:.0f}" for side in ("program", "hand"))
                rows.append([f"{name}, {what}, N = {count:,}", *times, f"{ratio:.2f}"])
    show("NumPyro programs against the same by hand", ["", "program µs", "hand µs", "ratio"], rows)


if __name__ == "__main__":
    main()
