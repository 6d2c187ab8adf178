"""The likelihood of a whole body in one pass is the elementwise one, for values, masks and every gradient."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from bodies import MARKERS, mixed_tree, states
from precision import epsilon

from poseppl.motion.geometry import join_cameras, look_at, marker_positions, project
from poseppl.motion.geometry.kinematics import unrolled_forward_kinematics
from poseppl.motion.likelihoods import ProjectedMarkers, projected_log_density

LENS = jnp.array([-0.21, 0.24, -0.001, 0.003, -0.07])
SHAPE = (2, len(MARKERS))


def scene(dtype, seed=0, count=1):
    """Two cameras 5 m away, one with distortion, and points that miss by a few standard deviations."""
    rng = np.random.default_rng(seed)
    tree = mixed_tree()
    state = jnp.asarray(states(tree, count, seed) * np.r_[0.2, 0.2, 0.2, np.ones(tree.dimension - 3)], dtype)
    cameras = join_cameras(
        [look_at((0, -6000, 500), (0, 0, 0)), look_at((6000, 0, 900), (0, 0, 0))._replace(distortion=LENS[None].astype(dtype))]
    )
    scale = jnp.asarray(rng.uniform(0.02, 0.05, SHAPE), dtype)
    points = jax.vmap(lambda x: project(cameras, marker_positions(tree, x)))(state)
    value = points + jnp.asarray(rng.normal(0, 0.05, points.shape), dtype)
    mask = jnp.asarray(rng.random(points.shape) < 0.7)
    return tree, cameras, state, scale, value, mask


@jax.jit
def elementwise(tree, cameras, state, scale, value, mask):
    """The same density with nothing of the package's gradients: scalar kinematics, dist.Normal, a mask."""
    positions = jnp.stack([jnp.stack(position) for position in unrolled_forward_kinematics(tree, list(state))])
    normal = dist.Normal(project(cameras, positions), scale[..., None])
    return jnp.sum(jnp.where(mask, normal.log_prob(value), 0.0))


@jax.jit
def summed(tree, cameras, state, scale, value, mask):
    return ProjectedMarkers(tree, cameras, state, scale).summed_log_prob(value, mask)


def close(a, b, dtype, factor=1000.0):
    """Equal to rounding, relative to the largest entry."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    np.testing.assert_allclose(a, b, atol=factor * epsilon(dtype) * max(1.0, np.abs(b).max()))


@pytest.mark.full
@pytest.mark.parametrize("seed", range(3))
def test_equals_elementwise_normals(dtype, seed):
    tree, cameras, (state,), scale, (value,), mask = scene(dtype, seed)
    everything = jnp.ones((*SHAPE, 2), bool)
    arguments = tree, cameras, state, scale, value
    distribution = ProjectedMarkers(tree, cameras, state, scale)
    assert distribution.batch_shape == (*SHAPE, 2)
    expected = elementwise(tree, cameras, state, scale, value, everything)
    for found in (jnp.sum(distribution.log_prob(value)), *(summed(*arguments, mask) for mask in (None, everything))):
        assert found.dtype == dtype
        close(found, expected, dtype)
    close(summed(*arguments, mask[0]), elementwise(tree, cameras, state, scale, value, mask[0]), dtype)
    scalar = ProjectedMarkers(tree, cameras, state, 0.03).summed_log_prob(value, None)
    close(scalar, elementwise(tree, cameras, state, jnp.full(SHAPE, 0.03, dtype), value, everything), dtype)


@pytest.mark.full
def test_a_wrong_noise_is_noticed(dtype):
    tree, cameras, (state,), scale, (value,), mask = scene(dtype)
    with pytest.raises(AssertionError):
        close(
            summed(tree, cameras, state, 1.01 * scale, value, mask[0]),
            elementwise(tree, cameras, state, scale, value, mask[0]),
            dtype,
        )


@pytest.mark.full
def test_every_gradient_against_automatic_differentiation(dtype):
    tree, cameras, (state,), scale, (value,), (mask,) = scene(dtype)
    everything = (0, 1, 2, 3, 4)
    found = jax.jit(jax.value_and_grad(summed, everything))(tree, cameras, state, scale, value, mask)
    expected = jax.jit(jax.value_and_grad(elementwise, everything))(tree, cameras, state, scale, value, mask)
    patterns = iter((np.array(tree.offset_pattern), np.array(tree.marker_pattern)))
    for i, (a, b) in enumerate(zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)):
        seen = next(patterns) if i in (1, 2) else True  # the scalar kinematics leaves out offsets that are always zero
        close(np.where(seen, a, 0), b, dtype, 5000)


@jax.jit
def whitened(tree, cameras, state, scale, mask):
    positions = jnp.stack([jnp.stack(position) for position in unrolled_forward_kinematics(tree, list(state))])
    return jnp.where(mask, project(cameras, positions) / scale[..., None], 0.0).ravel()


@pytest.mark.full
def test_whitened_jacobian_against_automatic_differentiation(dtype):
    """One particle, and a batch whose size is no multiple of the vector length; an unseen marker may have any noise."""
    tree, cameras, state, scale, _, (mask, *_) = scene(dtype, count=11)
    scale = jnp.where(mask.any(-1), scale, np.nan)
    closed = jax.jit(lambda x, seen: ProjectedMarkers(tree, cameras, x, scale).whitened_jacobian(seen))
    safe = jnp.where(mask.any(-1), scale, 1.0)
    derivative = jax.jit(jax.jacfwd(whitened, 2))
    expected = np.stack([derivative(tree, cameras, x, safe, mask) for x in state])
    assert closed(state[0], mask).shape == (mask.size, tree.dimension)
    close(closed(state[0], mask), expected[0], dtype)
    close(jax.jit(jax.vmap(closed, (0, None)))(state, mask), expected, dtype)
    with pytest.raises(AssertionError):
        close(closed(state[0], ~mask), expected[0], dtype)


@pytest.mark.full
@pytest.mark.parametrize("filling", [0.0, 1e30, -3e38, np.inf, np.nan])
def test_masked_entries_count_exactly_zero(dtype, filling):
    """Whatever stands in them: neither value nor gradient changes by a bit."""
    tree, cameras, (state,), scale, (value,), (mask,) = scene(dtype)
    run = jax.jit(jax.value_and_grad(summed, (0, 1, 2, 3, 4)))
    reference = run(tree, cameras, state, scale, jnp.where(mask, value, 0.5), mask)
    found = run(tree, cameras, state, scale, jnp.where(mask, value, filling), mask)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(reference), strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.all(np.asarray(found[1][4])[~np.asarray(mask)] == 0)


@pytest.mark.full
@pytest.mark.parametrize("filling", [0.1, np.inf])
def test_an_unseen_frame_is_zero(dtype, filling):
    tree, cameras, (state,), scale, (value,), _ = scene(dtype)
    nothing = jnp.zeros(value.shape, bool)
    density, gradients = jax.value_and_grad(summed, (0, 1, 2, 3))(
        tree, cameras, state, jnp.full(SHAPE, np.inf), jnp.full_like(value, filling), nothing
    )
    assert density == 0
    for leaf in jax.tree.leaves(gradients):
        np.testing.assert_array_equal(leaf, 0)


@pytest.mark.full
def test_impossible_data_is_not_hidden(dtype):
    tree, cameras, (state,), scale, (value,), _ = scene(dtype)
    assert np.isnan(summed(tree, cameras, state, scale, value.at[0, 0, 0].set(np.nan), None))
    assert summed(tree, cameras, state, scale, value.at[0, 0, 0].set(np.inf), None) == -np.inf


@pytest.mark.full
def test_batches():
    """Particles in any nesting, shared or own observations and cameras, and gradients in and out of vmap."""
    dtype = np.float32
    tree, cameras, state, scale, value, mask = scene(dtype, count=6)
    single = np.array([summed(tree, cameras, *row) for row in zip(state, [scale] * 6, value, mask, strict=True)])
    batch = jax.jit(jax.vmap(summed, (None, None, 0, None, 0, 0)))
    close(batch(tree, cameras, state, scale, value, mask), single, dtype)
    split = jax.tree.map(lambda leaf: leaf.reshape(2, 3, *leaf.shape[1:]), (state, value, mask))
    nested = jax.vmap(batch, (None, None, 0, None, 0, 0))(tree, cameras, split[0], scale, *split[1:])
    close(nested.reshape(6), single, dtype)
    repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (6, *leaf.shape)), cameras)
    own = jax.vmap(summed, (None, 0, 0, None, 0, 0))(tree, repeated, state, scale, value, mask)
    close(own, single, dtype)
    shared = jax.vmap(lambda x: summed(tree, cameras, x, scale, value[0], mask[0]))(state)
    close(shared[0], single[0], dtype)

    gradient = jax.jit(jax.grad(summed, 2))
    one = np.stack([gradient(tree, cameras, *row) for row in zip(state, [scale] * 6, value, mask, strict=True)])
    close(jax.vmap(gradient, (None, None, 0, None, 0, 0))(tree, cameras, state, scale, value, mask), one, dtype, 5000)
    total = jax.jit(jax.grad(lambda x: jnp.sum(batch(tree, cameras, x, scale, value, mask))))
    close(total(state), one, dtype, 5000)


@pytest.mark.full
@pytest.mark.parametrize("filling", [0.0, np.inf, np.nan])
def test_many_particles(filling):
    """A large batch may take another way to the same values than the gradient, which is compared elementwise above."""
    dtype = np.float32
    tree, cameras, (state,), scale, (value,), (mask,) = scene(dtype)
    crowd = state + jnp.asarray(np.random.default_rng(1).normal(0, 0.05, (5000, tree.dimension)), dtype)
    batch = jax.jit(jax.vmap(summed, (None, None, 0, None, None, None)))
    differentiated = jax.jit(jax.vmap(jax.value_and_grad(summed, 2), (None, None, 0, None, None, None)))
    found = batch(tree, cameras, crowd, scale, jnp.where(mask, value, filling), mask)
    expected, _ = differentiated(tree, cameras, crowd, scale, jnp.where(mask, value, 0.0), mask)
    close(found, expected, dtype)
    close(found[:1], elementwise(tree, cameras, crowd[0], scale, value, mask), dtype)


@pytest.mark.full
def test_nothing_is_known_of_the_masks_derivative(dtype):
    tree, cameras, (state,), scale, (value,), (mask,) = scene(dtype)
    seen = mask.astype(dtype)
    gradient = jax.grad(projected_log_density, 5)(tree, state, cameras, scale, value, seen)
    np.testing.assert_array_equal(gradient, 0)
