"""Types of NumPy arrays, by what they hold; shapes stand in docstrings. And how many bits JAX's have."""

from __future__ import annotations

from contextlib import AbstractContextManager
from importlib import import_module
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


def double_precision() -> AbstractContextManager[Any]:
    """64-bit JAX arrays inside a block, whatever the global setting."""
    namespace: Any = jax if hasattr(jax, "enable_x64") else import_module("jax.experimental")  # the latter before JAX 0.8
    block: AbstractContextManager[Any] = namespace.enable_x64(True)
    return block
