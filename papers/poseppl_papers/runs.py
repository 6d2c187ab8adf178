"""Common parts of jobs: arrays of runs, of one job or of several that share a filter's runs; timing of compiled functions."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from poseppl.arrays import Floats
from poseppl_papers.experiment import Results


def blocks_of(number: int, size: int) -> list[tuple[int, ...]]:
    """Numbers of runs in blocks, one for each job."""
    return [tuple(range(first, min(first + size, number))) for first in range(0, number, size)]


def stacked(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Arrays of runs, or of whatever rows are, one below the other."""
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def joined(jobs: Sequence[Any], results: Results) -> dict[str, Floats]:
    """Results of jobs, their runs one after the other, in double precision."""
    blocks = [results[job.key] for job in jobs]
    return {name: np.concatenate([np.asarray(block[name], float) for block in blocks]) for name in blocks[0]}


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
