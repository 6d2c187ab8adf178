"""Timing of compiled functions."""

from __future__ import annotations

import time
from typing import Any

import jax


def timed(function: Any, *arguments: Any) -> tuple[Any, float]:
    """Call a function: its result, on the host, and the seconds until it was there."""
    result, seconds = finished(function, *arguments)
    return jax.device_get(result), seconds


def finished(function: Any, *arguments: Any) -> tuple[Any, float]:
    """Call a function: its result, where it is, and the seconds until it was there."""
    ready: Any = jax.block_until_ready
    began = time.perf_counter()
    result = ready(function(*arguments))
    return result, time.perf_counter() - began
