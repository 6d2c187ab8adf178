"""Functions that are written for a batch in the last axis give the same under any ``vmap``, pictures among their arguments."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.geometry.batch_last import batch_last

FRAMES, PARTICLES = 5, 3


def _look_up(x, picture):
    """The pixel of a picture (H, W, 1) that x (2, N) chooses, and its second coordinate beside it."""
    place = (x[0] * picture.size).astype(int)
    return jnp.take(picture.reshape(-1), place, mode="clip") + x[1]


@pytest.mark.parametrize("chunk", [None, 2])
def test_frames_of_pictures(chunk):
    rng = np.random.default_rng(0)
    pictures, x = rng.random((FRAMES, 60, 50)), rng.random((FRAMES, PARTICLES, 2))
    look_up = batch_last(_look_up, chunk=chunk)
    expected = [[pictures[t].flat[int(a * 3000)] + b for a, b in x[t]] for t in range(FRAMES)]
    x, pictures = jnp.asarray(x), jnp.asarray(pictures)
    frames_of_particles = jax.vmap(jax.vmap(look_up, (0, None)))(x, pictures)
    particles_of_frames = jax.vmap(jax.vmap(look_up), (1, None), 1)(x, pictures)
    np.testing.assert_allclose(frames_of_particles, expected, rtol=1e-6)
    np.testing.assert_allclose(particles_of_frames, expected, rtol=1e-6)


@pytest.mark.full
def test_pictures_are_not_copied():
    """One for each frame in the program, however many particles look at it."""
    look_up = batch_last(_look_up)
    particles = jax.ShapeDtypeStruct((FRAMES, 1000, 2), jnp.float32)
    pictures = jax.ShapeDtypeStruct((FRAMES, 60, 50), jnp.float32)
    memory = jax.jit(jax.vmap(jax.vmap(look_up, (0, None)))).lower(particles, pictures).compile().memory_analysis()
    assert memory.temp_size_in_bytes < 60 * 50 * 4 * 100


@pytest.mark.full
def test_second_derivatives():
    """Derivatives in both modes, over particles, are those of the function itself."""

    def wave(x, size):
        return size[0] * jnp.sin(x[0] * x[1]) + x[1] ** 3

    batched, sizes = batch_last(wave), jnp.asarray([0.7])
    x = jnp.asarray(np.random.default_rng(0).normal(size=(PARTICLES, 2)))
    expected = jax.vmap(jax.hessian(wave), (0, None))(x, sizes)
    for outer in (jax.jacfwd, jax.jacrev):
        for inner in (jax.jacfwd, jax.jacrev):
            np.testing.assert_allclose(jax.vmap(outer(inner(batched)), (0, None))(x, sizes), expected, rtol=1e-5)
