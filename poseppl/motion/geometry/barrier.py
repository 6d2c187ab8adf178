"""Keep what several computations share from being computed again in each of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

computed_once: Callable[[Any], Any] = jax.lax.optimization_barrier
"""Arrays to the same arrays: the compiler computes them before what follows, and does not fuse them into each of its uses."""
