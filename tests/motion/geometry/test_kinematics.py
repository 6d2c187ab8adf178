"""Kinematics against a plain NumPy loop, and their hand-written gradient against every other way to get it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import JOINTS, MARKERS, mixed_tree, plain_kinematics, states
from precision import epsilon, precision

from poseppl.motion.geometry import marker_positions
from poseppl.motion.geometry.kinematics import unrolled_forward_kinematics

SIZE = 3000.0  # mm: tolerances in mm are this times the rounding


def tolerance(dtype, factor=20):
    return factor * SIZE * epsilon(dtype)


def scalar_form(tree, state):
    """The same positions through :func:`unrolled_forward_kinematics`, which JAX differentiates by itself."""
    return jnp.stack([jnp.stack(position) for position in unrolled_forward_kinematics(tree, list(state))])


def forces(seed=7):
    return jnp.asarray(np.random.default_rng(seed).normal(size=(len(MARKERS), 3)))


def energy(positions):
    """A nonlinear function of the markers."""
    return jnp.sum(jnp.sin(positions / 500.0) * forces()) * 500.0


def test_positions(dtype):
    tree = mixed_tree()
    for state in states(tree, 20):
        expected = plain_kinematics(JOINTS, MARKERS, state)
        found = marker_positions(tree, jnp.asarray(state))
        assert found.dtype == dtype
        np.testing.assert_allclose(found, expected, atol=tolerance(dtype))
        np.testing.assert_allclose(scalar_form(tree, jnp.asarray(state)), expected, atol=tolerance(dtype))


@pytest.mark.full
def test_gradient_against_automatic_differentiation(dtype):
    """With respect to the state and to both kinds of offsets."""
    tree = mixed_tree()
    by_hand = jax.jit(jax.grad(lambda tree, state: energy(marker_positions(tree, state)), (0, 1)))
    automatic = jax.jit(jax.grad(lambda tree, state: energy(scalar_form(tree, state)), (0, 1)))
    patterns = np.array(tree.offset_pattern), np.array(tree.marker_pattern)
    for state in jnp.asarray(states(tree, 10)):
        (tree_a, state_a), (tree_b, state_b) = by_hand(tree, state), automatic(tree, state)
        np.testing.assert_allclose(state_a, state_b, atol=tolerance(dtype))
        for a, b, pattern in zip(jax.tree.leaves(tree_a), jax.tree.leaves(tree_b), patterns, strict=True):
            # the scalar form leaves out offsets that are zero by construction, and with them their gradient
            np.testing.assert_allclose(np.where(pattern, a, 0), b, atol=tolerance(dtype))


@pytest.mark.full
def test_gradient_against_finite_differences():
    with precision(np.float64):
        tree = mixed_tree()
        state = jnp.asarray(states(tree, 1)[0])

        def function(offsets, marker_offsets, state):
            return energy(marker_positions(tree.with_offsets(offsets, marker_offsets), state))

        arguments = [tree.offsets, tree.marker_offsets, state]
        gradients = jax.grad(function, (0, 1, 2))(*arguments)
        compiled = jax.jit(function)
        for place, gradient in enumerate(gradients):
            for index in np.ndindex(gradient.shape):
                if place == 0 and index[0] == 0:
                    assert gradient[index] == 0.0  # the root has no offset
                    continue
                sides = []
                for step in (1e-4, -1e-4):
                    moved = list(arguments)
                    moved[place] = moved[place].at[index].add(step)
                    sides.append(compiled(*moved))
                np.testing.assert_allclose((sides[0] - sides[1]) / 2e-4, gradient[index], atol=1e-4)


@pytest.mark.full
def test_a_wrong_lever_is_noticed(dtype):
    """The comparison above is sharp enough: the gradient of a body with one joint displaced by 1 mm is refused."""
    tree = mixed_tree()
    state = jnp.asarray(states(tree, 1)[0])
    moved = tree.with_offsets(tree.offsets.at[1, 0].add(1.0), tree.marker_offsets)
    right, wrong = (jax.grad(lambda x, body=body: energy(marker_positions(body, x)))(state) for body in (tree, moved))
    assert np.max(np.abs(right - wrong)) > tolerance(dtype)


@pytest.mark.full
def test_batches_of_every_kind(dtype):
    tree = mixed_tree()
    batch = jnp.asarray(states(tree, 6))
    positions = jax.jit(marker_positions)
    single = np.stack([positions(tree, state) for state in batch])
    over = jax.vmap(marker_positions, (None, 0))
    np.testing.assert_allclose(over(tree, batch), single, atol=tolerance(dtype))
    np.testing.assert_allclose(jax.jit(over)(tree, batch), single, atol=tolerance(dtype))
    nested = jax.vmap(over, (None, 0))(tree, batch.reshape(2, 3, -1))
    np.testing.assert_allclose(nested.reshape(single.shape), single, atol=tolerance(dtype))
    crossed = jax.vmap(over, (None, 1), 1)(tree, batch.reshape(2, 3, -1))
    np.testing.assert_allclose(crossed.reshape(single.shape), single, atol=tolerance(dtype))


@pytest.mark.full
def test_gradients_of_batches(dtype):
    tree = mixed_tree()
    batch = jnp.asarray(states(tree, 6))
    one = jax.jit(jax.grad(lambda state: energy(marker_positions(tree, state))))
    single = np.stack([one(state) for state in batch])
    np.testing.assert_allclose(jax.vmap(one)(batch), single, atol=tolerance(dtype))
    nested = jax.vmap(jax.vmap(one))(batch.reshape(3, 2, -1))
    np.testing.assert_allclose(nested.reshape(single.shape), single, atol=tolerance(dtype))

    def total(batch):
        return jnp.sum(jax.vmap(lambda state: energy(marker_positions(tree, state)))(batch))

    np.testing.assert_allclose(jax.jit(jax.grad(total))(batch), single, atol=tolerance(dtype))
    jacobian = jax.jit(jax.jacrev(lambda state: marker_positions(tree, state)))(batch[0])
    automatic = jax.jit(jax.jacfwd(lambda state: scalar_form(tree, state)))(batch[0])
    np.testing.assert_allclose(jacobian, automatic, atol=tolerance(dtype))


@pytest.mark.full
def test_batched_trees(dtype):
    """Limb lengths that differ by particle, with shared and with batched states, and the gradient of a shared tree."""
    tree = mixed_tree()
    batch = jnp.asarray(states(tree, 4))
    factors = jnp.array([0.9, 1.0, 1.1, 1.2])
    positions = jax.jit(marker_positions)
    grown = jax.vmap(lambda f: tree.with_offsets(f * tree.offsets, f * tree.marker_offsets))(factors)
    both = jax.vmap(marker_positions)(grown, batch)
    shared = jax.vmap(marker_positions, (0, None))(grown, batch[0])
    for i, factor in enumerate(factors):
        own = tree.with_offsets(factor * tree.offsets, factor * tree.marker_offsets)
        np.testing.assert_allclose(both[i], positions(own, batch[i]), atol=tolerance(dtype))
        np.testing.assert_allclose(shared[i], positions(own, batch[0]), atol=tolerance(dtype))

    def total(tree):
        return jnp.sum(jax.vmap(lambda state: energy(marker_positions(tree, state)))(batch))

    summed = jax.jit(jax.grad(total))(tree)
    one = jax.jit(jax.grad(lambda tree, state: energy(marker_positions(tree, state))))
    apart = [one(tree, state) for state in batch]
    np.testing.assert_allclose(summed.offsets, sum(one.offsets for one in apart), atol=tolerance(dtype))
    np.testing.assert_allclose(summed.marker_offsets, sum(one.marker_offsets for one in apart), atol=tolerance(dtype))


@pytest.mark.full
@pytest.mark.parametrize("count", [0, 1])
def test_degenerate_batches(count):
    tree = mixed_tree()
    found = jax.vmap(marker_positions, (None, 0))(tree, jnp.zeros((count, tree.dimension)))
    assert found.shape == (count, len(MARKERS), 3)
