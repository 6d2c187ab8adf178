"""Sequences on the host: data and inputs of T frames, of which some inputs never change.

Inputs of frame t are the t-th rows of `inputs`, except for what is wrapped in :class:`Constant`: cameras that stand still need
no copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least
from poseppl.particles.stacks import rows_of
from poseppl.program import Observation
from poseppl.program.observation import check_is_observation


class Constant(NamedTuple):
    """Marks a part of the inputs that is the same at every frame."""

    value: Any


class Layout(NamedTuple):
    """Where the inputs that vary and those that are constant go."""

    tree: Any
    constant: tuple[bool, ...]

    def join(self, varying: Sequence[Any], constant: Sequence[Any]) -> Any:
        """The inputs, from their two kinds of leaves."""
        rest, fixed = iter(varying), iter(constant)
        return jax.tree.unflatten(self.tree, [next(fixed) if flag else next(rest) for flag in self.constant])


def device_array(value: Any, declared: Any = None) -> Array:
    """The value as a JAX array of its own dtype, or of the declared one if that holds it exactly.

    A Python number has a weak dtype, and an integer another one than a float: each would be compiled for again.
    """
    array = jnp.asarray(value)
    dtype = array.dtype if declared is None or jnp.promote_types(array.dtype, declared) != declared else declared
    return jax.lax.convert_element_type(array, dtype) if array.weak_type or dtype != array.dtype else array


def _split_inputs(inputs: Any) -> tuple[Layout, list[Any], list[Any]]:
    leaves, tree = jax.tree.flatten(inputs, is_leaf=lambda node: isinstance(node, Constant))
    flags = tuple(isinstance(leaf, Constant) for leaf in leaves)
    constant = [jax.tree.map(device_array, leaf.value) for leaf in leaves if isinstance(leaf, Constant)]
    return Layout(tree, flags), [leaf for leaf in leaves if not isinstance(leaf, Constant)], constant


def frame_inputs(inputs: Any, frame: int) -> Any:
    """The inputs of one frame, with :class:`Constant` taken off."""
    layout, varying, constant = _split_inputs(inputs)
    return layout.join([jnp.asarray(leaf[frame]) for leaf in varying], constant)


def rows_of_inputs(inputs: Any, frames: slice) -> Any:
    """The inputs of some frames, with :class:`Constant` taken off."""
    layout, varying, constant = _split_inputs(inputs)
    return layout.join([leaf[frames] for leaf in varying], constant)


def stacked_inputs(inputs: Any, num_frames: int) -> Any:
    """Inputs of T frames as JAX arrays, each with a leading T, what is wrapped in :class:`Constant` repeated.

    Raises:
        ValueError: An array does not have T rows.
    """
    _check_inputs(inputs, num_frames)
    layout, varying, constant = _split_inputs(inputs)
    return _stacked(layout, varying, constant, num_frames)


def _stacked(layout: Layout, varying: list[Any], constant: list[Any], num_frames: int) -> Any:
    repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_frames, *jnp.shape(leaf))), constant)
    return layout.join([jax.tree.map(jnp.asarray, leaf) for leaf in varying], repeated)


def _check_rows(observations: Observation, num_frames: int) -> None:
    for leaf in jax.tree.leaves(observations):
        if leaf.ndim == 0 or leaf.shape[0] != num_frames:
            raise ValueError(
                f"an array of the observations has shape {leaf.shape}; expected a leading axis of {num_frames} frames"
            )


def _check_inputs(inputs: Any, num_frames: int) -> None:
    for path, leaf in jax.tree_util.tree_flatten_with_path(inputs, is_leaf=lambda node: isinstance(node, Constant))[0]:
        if isinstance(leaf, Constant):
            continue
        name, expected = f"inputs{jax.tree_util.keystr(path)}", f"a leading axis of {num_frames} frames"
        array: Any = leaf if isinstance(leaf, Array) else np.asarray(leaf)
        if array.dtype.kind in "OmMSU":
            raise ValueError(f"{name} is of the type {array.dtype}; expected numbers, with {expected}")
        if array.ndim == 0 or len(array) != num_frames:
            raise ValueError(
                f"{name} has shape {array.shape}; expected {expected} (numpy.asarray makes an array of a list of numbers; "
                "wrap inputs that do not change in Constant)"
            )


class FrameSequence(NamedTuple):
    """Data and inputs of a sequence on the host.

    Attributes:
        observations: Data of the frames that are held.
        layout: Where the inputs go.
        varying: Inputs that change, of the frames that are held.
        constant: Those that do not.
        num_frames: How many frames are held.
        before: How many came before them.
    """

    observations: Observation
    layout: Layout
    varying: list[Any]
    constant: list[Any]
    num_frames: int
    before: int = 0

    def stacked_inputs(self) -> Any:
        """The inputs of all frames as JAX arrays, each with a leading T, what is constant repeated."""
        return _stacked(self.layout, self.varying, self.constant, self.num_frames)

    def inputs_are_finite(self, frame: int) -> bool:
        """Whether no input of a frame, nor a constant one, is NaN or infinite."""
        given = jax.tree.leaves((rows_of(self.varying, frame - self.before), self.constant))
        return all(bool(np.isfinite(leaf).all()) for leaf in map(np.asarray, given) if leaf.dtype.kind == "f")

    def frame(self, index: int) -> tuple[Observation, list[Any]]:
        """Data and varying inputs of one frame."""
        return rows_of((self.observations, self.varying), index)

    def rows(self, start: int, chunk: int) -> tuple[Observation, list[Any]]:
        """`chunk` frames from `start` on; beyond the end the last frame stands in, and is not read."""
        index = np.minimum(np.arange(start, start + chunk) - self.before, self.num_frames - 1)
        return rows_of((self.observations, self.varying), index)


def frame_sequence(observations: Observation, inputs: Any, num_frames: int | None) -> FrameSequence:
    """Check that everything has T rows, and separate what varies from what does not.

    Raises:
        ValueError: The data are no Observation, or an array does not have T rows.
    """
    check_is_observation(observations)
    if num_frames is None:
        leaves = jax.tree.leaves(observations)
        if not leaves or np.ndim(leaves[0]) == 0:
            raise ValueError(
                "the observations have no leading axis of frames; give num_frames, or feed single frames to Online"
            )
        num_frames = len(leaves[0])
    check_at_least(1, num_frames=num_frames)
    _check_inputs(inputs, num_frames)
    layout, varying, constant = _split_inputs(inputs)
    seen, varying = jax.tree.map(np.asarray, (observations, varying))
    _check_rows(seen, num_frames)
    return FrameSequence(seen, layout, varying, constant, num_frames)
