"""Types of NumPy arrays, by what they hold; shapes stand in docstrings. And how many bits JAX's have, and their products.

On a GPU or TPU JAX rounds the factors of a product of float32 matrices to 10 bits or 7, unless told otherwise: covariances are
then off in the third digit, and moves that are whitened by them leave another density invariant than the one asked for. What is
compiled here multiplies as a CPU does, whatever the device, unless the user has set ``jax_default_matmul_precision``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

import jax
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

P = ParamSpec("P")
R = TypeVar("R")
_MARK = "_full_precision"


def double_precision() -> AbstractContextManager[Any]:
    """64-bit JAX arrays inside a block, whatever the global setting."""
    namespace: Any = jax if hasattr(jax, "enable_x64") else import_module("jax.experimental")  # the latter before JAX 0.8
    block: AbstractContextManager[Any] = namespace.enable_x64(True)
    return block


def full_precision() -> AbstractContextManager[Any]:
    """Products of float32 in float32 for what is traced inside a block; on a CPU they are anyway, and nothing changes."""
    chosen = getattr(jax.config, "jax_default_matmul_precision", None)
    return nullcontext() if chosen or jax.default_backend() == "cpu" else jax.default_matmul_precision("highest")


def with_full_precision(function: Callable[P, R]) -> Callable[P, R]:
    """The function, traced in :func:`full_precision`; itself where it is, so that what was compiled for it serves again."""
    if hasattr(function, _MARK):
        return function

    @functools.wraps(function)
    def precise(*args: P.args, **kwargs: P.kwargs) -> R:
        with full_precision():
            return function(*args, **kwargs)

    setattr(precise, _MARK, True)
    return precise


def jit(function: Callable[..., Any], **options: Any) -> jax.stages.Wrapped:
    """`jax.jit` of a function in :func:`full_precision`."""
    return jax.jit(with_full_precision(function), **options)
