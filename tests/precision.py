"""Single and double precision side by side."""

from __future__ import annotations

from importlib import import_module

import jax
import numpy as np

DTYPES = (np.float32, np.float64)


def precision(dtype):
    """A block in which JAX makes arrays of ``dtype`` by default."""
    namespace = jax if hasattr(jax, "enable_x64") else import_module("jax.experimental")
    return namespace.enable_x64(dtype == np.float64)


def epsilon(dtype) -> float:
    return float(np.finfo(dtype).eps)
