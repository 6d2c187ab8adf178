"""Sequences on the host: data and inputs of T frames, of which some inputs never change (:class:`Constant`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.checks import check_at_least
from poseppl.particles.stacks import tree_index
from poseppl.program import Observation
from poseppl.program.frame_inputs import (
    Constant as Constant,
    Layout as Layout,
    check_input_rows,
    device_array as device_array,
    joined,
    split_inputs,
    stacked_inputs as stacked_inputs,
)
from poseppl.program.observation import check_is_observation


def frame_inputs(inputs: Any, frame: int) -> Any:
    """The inputs of one frame, with :class:`Constant` taken off."""
    layout, varying, constant = split_inputs(inputs)
    return layout.join([jnp.asarray(leaf[frame]) for leaf in varying], constant)


def rows_of_inputs(inputs: Any, frames: slice) -> Any:
    """The inputs of some frames, with :class:`Constant` taken off."""
    layout, varying, constant = split_inputs(inputs)
    return layout.join([leaf[frames] for leaf in varying], constant)


def _check_rows(observations: Observation, num_frames: int) -> None:
    for leaf in jax.tree.leaves(observations):
        if leaf.ndim == 0 or leaf.shape[0] != num_frames:
            raise ValueError(
                f"an array of the observations has shape {leaf.shape}; expected a leading axis of {num_frames} frames"
            )


class FrameSequence(NamedTuple):
    """Data and inputs of a sequence on the host.

    Attributes:
        observations: Data of the frames that are held.
        layout: Devices of the inputs.
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
        return joined(self.layout, self.varying, self.constant, self.num_frames)

    def inputs_are_finite(self, frame: int) -> bool:
        """Whether no input of a frame, nor a constant one, is NaN or infinite."""
        given = jax.tree.leaves((tree_index(self.varying, frame - self.before), self.constant))
        return all(bool(np.isfinite(leaf).all()) for leaf in map(np.asarray, given) if leaf.dtype.kind == "f")

    def frame(self, index: int) -> tuple[Observation, list[Any]]:
        """Data and varying inputs of one frame."""
        return tree_index((self.observations, self.varying), index)

    def rows(self, start: int, chunk: int) -> tuple[Observation, list[Any]]:
        """`chunk` frames from `start` on; beyond the end the last frame stands in, and is not read."""
        index = np.minimum(np.arange(start, start + chunk) - self.before, self.num_frames - 1)
        return tree_index((self.observations, self.varying), index)


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
    check_input_rows(inputs, num_frames)
    layout, varying, constant = split_inputs(inputs)
    seen, varying = jax.tree.map(np.asarray, (observations, varying))
    _check_rows(seen, num_frames)
    return FrameSequence(seen, layout, varying, constant, num_frames)
