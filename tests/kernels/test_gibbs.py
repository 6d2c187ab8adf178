"""A Gibbs kernel of an integer that is drawn and of a number that a kernel of BlackJAX's moves, against quadrature."""

from __future__ import annotations

from functools import partial
from typing import Any

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import z_scores

from poseppl.kernels import CustomKernel, gibbs_kernel
from poseppl.kernels.adapted_chain import unchecked

CENTRES = jnp.array([-0.5, 1.5])
CHAINS, STEPS, WARMUP = 400, 120, 20


def log_density(position: Any) -> Any:
    """A label of odds 1 to 3, a number about its centre, and a likelihood that is conjugate to neither."""
    label, x = position["label"], position["x"]
    return jnp.log(jnp.array([0.25, 0.75]))[label] - 0.5 * (x - CENTRES[label]) ** 2 - 0.25 * x**4


def draw_label(rng_key: Any, position: Any) -> Any:
    logits = jax.vmap(lambda label: log_density({**position, "label": label}))(jnp.arange(2))
    return jax.random.categorical(rng_key, logits)


def exact() -> np.ndarray:
    """The label's mean and the number's first two moments."""
    grid = np.linspace(-6.0, 6.0, 4001)
    density = np.exp(np.array([np.asarray(log_density({"label": label, "x": grid}), float) for label in (0, 1)]))
    density /= density.sum()
    return np.array([density[1].sum(), (density * grid).sum(), (density * grid**2).sum()])


def nuts() -> CustomKernel:
    kernel: Any = blackjax.nuts.build_kernel()
    return CustomKernel(
        blackjax.nuts.init, lambda key, state, density, step: kernel(unchecked(key), state, density, step, jnp.ones(1), 4)
    )


def walk() -> CustomKernel:
    kernel = blackjax.additive_step_random_walk.build_kernel()
    normal = blackjax.mcmc.random_walk.normal
    return CustomKernel(
        blackjax.additive_step_random_walk.init, lambda key, state, density, step: kernel(key, state, density, normal(step))
    )


KERNELS = {
    "random walk": (walk, 1.5),
    "mala": (lambda: CustomKernel(blackjax.mala.init, blackjax.mala.build_kernel()), 0.6),
    "nuts": (nuts, 0.5),
}


@pytest.mark.parametrize("name", ["random walk", *(pytest.param(name, marks=pytest.mark.full) for name in ("mala", "nuts"))])
def test_draws_have_the_joint_distribution(name: str) -> None:
    build, step_size = KERNELS[name]
    kernel, size = gibbs_kernel({"label": draw_label, "x": build()}), jnp.asarray(step_size)

    def chain(rng_key: Any) -> Any:
        state = kernel.init({"label": jnp.asarray(0), "x": jnp.asarray(0.0)}, log_density)

        def advance(state: Any, key: Any) -> Any:
            state, moves = kernel.step(key, state, log_density, {"x": size})
            return state, (state.position, moves["x"].acceptance)

        return jax.lax.scan(advance, state, jax.random.split(rng_key, STEPS))[1]

    draws, acceptance = jax.jit(partial(jax.vmap(chain)))(jax.random.split(jax.random.key(0), CHAINS))
    label, x = (np.asarray(draws[each], float)[:, WARMUP:] for each in ("label", "x"))
    means = np.stack([label.mean(1), x.mean(1), (x**2).mean(1)], 1)
    assert np.abs(z_scores(means, exact())).max() < 4.5
    assert 0.2 < float(acceptance.mean()) < 1.0


def test_names_that_are_not_those_of_the_blocks_are_refused() -> None:
    with pytest.raises(ValueError, match="blocks, \\['label'\\]"):
        gibbs_kernel({"label": draw_label}).init({"x": 0.0}, log_density)
