"""Inputs of a sequence: one row a frame, and what never changes without rows.

Inputs of frame t are the t-th rows of `inputs`, except for what is wrapped in :class:`Constant`: cameras that stand still need
no copies.

>>> stacked_inputs({"push": np.array([0.0, 1.0, 0.5]), "step": Constant(0.1)}, 3)["step"].shape
(3,)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

_COARSE = 0.25
"""Spacing of numbers in float32, in steps from frame to frame, above which rounding is reported."""
_NO_STEP = 1e-14
"""Share of a number below which its change is float64's own rounding."""


class Constant(NamedTuple):
    """Marks a part of the inputs that is the same at every frame."""

    value: Any


class Layout(NamedTuple):
    """The positions of the inputs that vary and of those that are constant."""

    tree: Any
    constant: tuple[bool, ...]

    def join(self, varying: Sequence[Any], constant: Sequence[Any]) -> Any:
        """The inputs, from their two kinds of leaves."""
        rest, fixed = iter(varying), iter(constant)
        return jax.tree.unflatten(self.tree, [next(fixed) if flag else next(rest) for flag in self.constant])


def device_array(value: Any, declared: Any = None) -> Array:
    """The value as a JAX array of its own dtype, or of the declared one if that represents it exactly.

    A Python number has a weak dtype, and an integer another one than a float: each would be compiled for again.
    """
    array = jnp.asarray(value)
    dtype = array.dtype if declared is None or jnp.promote_types(array.dtype, declared) != declared else declared
    return jax.lax.convert_element_type(array, dtype) if array.weak_type or dtype != array.dtype else array


def split_inputs(inputs: Any) -> tuple[Layout, list[Any], list[Any]]:
    """The positions of inputs, those that vary, and those that are constant."""
    leaves, tree = jax.tree.flatten(inputs, is_leaf=lambda node: isinstance(node, Constant))
    flags = tuple(isinstance(leaf, Constant) for leaf in leaves)
    constant = [jax.tree.map(device_array, leaf.value) for leaf in leaves if isinstance(leaf, Constant)]
    return Layout(tree, flags), [leaf for leaf in leaves if not isinstance(leaf, Constant)], constant


def stacked_inputs(inputs: Any, num_frames: int) -> Any:
    """Inputs of T frames as JAX arrays, each with a leading T, what is wrapped in :class:`Constant` repeated.

    Raises:
        ValueError: An array does not have T rows.
    """
    check_input_rows(inputs, num_frames)
    layout, varying, constant = split_inputs(inputs)
    return joined(layout, varying, constant, num_frames)


def joined(layout: Layout, varying: list[Any], constant: list[Any], num_frames: int) -> Any:
    """Inputs of T frames, from their two kinds of leaves."""
    repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_frames, *jnp.shape(leaf))), constant)
    return layout.join([jax.tree.map(jnp.asarray, leaf) for leaf in varying], repeated)


def check_input_rows(inputs: Any, num_frames: int) -> None:
    """Refuse an array that does not have T rows."""
    for path, leaf in jax.tree_util.tree_flatten_with_path(inputs, is_leaf=lambda node: isinstance(node, Constant))[0]:
        if isinstance(leaf, Constant):
            continue
        name, expected = f"inputs{jax.tree_util.keystr(path)}", f"a leading axis of {num_frames} frames"
        array: Any = leaf if isinstance(leaf, Array) else np.asarray(leaf)
        if array.dtype.kind in "OmMSU":
            raise ValueError(f"{name} is of the type {array.dtype}; expected numbers, with {expected}")
        if array.dtype.kind in "iu" and array.size and not _fits(array):
            raise ValueError(
                f"{name} has integers up to {array.max()}, which do not fit {jnp.result_type(int)}. Subtract a start, or call "
                "jax.config.update('jax_enable_x64', True) first"
            )
        if array.ndim == 0 or len(array) != num_frames:
            raise ValueError(
                f"{name} has shape {array.shape}; expected {expected} (numpy.asarray makes an array of a list of numbers; "
                "wrap inputs that do not change in Constant)"
            )


def _fits(integers: Any) -> bool:
    """Whether integers keep their values as JAX's own, or as their own smaller type."""
    ends = np.iinfo(jnp.result_type(int))
    return integers.dtype.itemsize <= ends.dtype.itemsize or bool(ends.min <= integers.min() and integers.max() <= ends.max)


def coarse_inputs(inputs: Any) -> list[str]:
    """Sentences on inputs of T frames, given in float64, whose steps from frame to frame float32 rounds away."""
    if jnp.result_type(float) != jnp.float32:
        return []
    leaves = jax.tree_util.tree_flatten_with_path(inputs, is_leaf=lambda node: isinstance(node, Constant))[0]
    found = [_coarse(f"inputs{jax.tree_util.keystr(path)}", leaf) for path, leaf in leaves if not isinstance(leaf, Constant)]
    return [text for text in found if text]


def _coarse(name: str, leaf: Any) -> str | None:
    values = np.asarray(leaf)
    if values.dtype != np.float64 or not values.size or not np.isfinite(values).all():
        return None
    size = np.abs(values).max(0)
    steps = np.abs(np.diff(values, axis=0))
    # what float64 itself rounds is no step
    steps = np.where(steps > _NO_STEP * size, steps, np.nan)
    spacing = np.spacing(size.astype(np.float32)).astype(float)
    moving = np.isfinite(steps).any(0)
    if not np.any(moving):
        return None
    typical = np.nanmedian(np.where(moving, steps, 0.0), axis=0)
    coarse = moving & (spacing > _COARSE * typical)
    if not np.any(coarse):
        return None
    at = np.unravel_index(int(np.argmax(np.where(coarse, spacing, 0.0))), coarse.shape)
    return (
        f"{name}: numbers as large as {size[at]:.10g} are {spacing[at]:.3g} apart in float32, and change by {typical[at]:.3g} "
        "from frame to frame: rounding decides. Subtract a start, or call jax.config.update('jax_enable_x64', True) first"
    )
