"""Draws of a program's sites: each from a key of its own, however they are computed."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from poseppl.program.execution import draw


def test_small_normal_sites_draw_what_their_own_keys_draw():
    shapes: dict[str, tuple[int, ...]] = {"a": (3,), "b": (), "c": (2, 2), "d": (5,)}

    def program() -> None:
        for name, shape in shapes.items():
            numpyro.sample(name, dist.Normal(jnp.full(shape, 2.0), 3.0))

    rng_key = jax.random.key(3)
    drawn = draw(program, (), rng_key, len(shapes))
    for key, (name, shape) in zip(jax.random.split(rng_key, len(shapes)), shapes.items(), strict=True):
        np.testing.assert_array_equal(drawn[name], 2.0 + 3.0 * jax.random.normal(key, shape))


def test_several_draws_of_a_small_site_are_all_drawn():
    def program() -> None:
        numpyro.sample("one", dist.Normal(0.0, 1.0))
        numpyro.sample("three", dist.Normal(0.0, 1.0), sample_shape=(3,))

    drawn = draw(program, (), jax.random.key(0), 2)
    assert drawn["one"].shape == () and len(set(drawn["three"].tolist())) == 3
