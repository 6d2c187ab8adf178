"""Inefficiency factors, R-hat and Monte Carlo errors of all frames and coordinates of a result beside ArviZ's functions.

python -m benchmarks.diagnostics [--quick] [--frames 80] [--dofs 28]

Times are processor seconds, which a busy machine changes little. ArviZ's ESS of arviz_stats.numba.diagnostics takes part where
numba and einops are installed; it has no R-hat of halved chains and no MCSE.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import xarray as xr
from arviz_stats.base import array_stats
from scipy.signal import lfilter

from benchmarks.timing import arguments, show
from poseppl.diagnostics import inefficiency, mixing, split_rhat

SHAPES = {"4 chains of 250 draws": (4, 250), "20 chains of 50 draws": (20, 50)}
HAS_NUMBA = all(map(find_spec, ("numba", "einops")))


def main() -> None:
    options = arguments(__doc__, frames=80, dofs=28)
    frames = 4 if options.quick else options.frames
    rows = []
    for label, shape in SHAPES.items():
        noise = np.random.default_rng(0).standard_normal((*shape, frames, options.dofs))
        draws = lfilter([1.0], [1.0, -0.7], noise, axis=1)
        for name, own in (("ESS", inefficiency), ("R-hat", split_rhat), ("ESS, R-hat and MCSE", mixing)):
            runs = {"own": partial(own, draws), "ArviZ": partial(arviz, name, draws)}
            if HAS_NUMBA and name == "ESS":
                dims = ("chain", "draw", "frame", "state_dim")
                array = xr.DataArray(draws, dims=dims, coords={"chain": range(shape[0]), "draw": range(shape[1])})
                runs["numba"] = partial(import_module("arviz_stats.numba.diagnostics").ess, array, method="mean")
            each, *others = (
                1e6 * value / (frames * options.dofs) for value in processor_seconds(runs, 1 if options.quick else 3)
            )
            rows.append([f"{name}, {label}", f"{each:.1f}", *(f"{other:.1f} ({other / each:.1f})" for other in others), ""])
    head = ["", "ours, µs each", "ArviZ, µs each (ratio)", "ArviZ with numba"]
    show(f"{frames} frames, {options.dofs} coordinates", head, [row[:4] for row in rows])


def arviz(names: str, draws: np.ndarray[Any, Any]) -> None:
    """Call those of ArviZ's functions of arrays that are named."""
    for name, method in (("ESS", "mean"), ("R-hat", "split"), ("MCSE", "mean")):
        if name in names:
            getattr(array_stats, name.lower().replace("-", ""))(draws, chain_axis=0, draw_axis=1, method=method)


def processor_seconds(runs: dict[str, Callable[[], Any]], repetitions: int) -> list[float]:
    """Median processor time of each function, run in turns after a first call that is not counted."""
    spent: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repetitions + 1):
        for name, run in runs.items():
            start = time.process_time()
            run()
            spent[name].append(time.process_time() - start)
    return [statistics.median(values[1:]) for values in spent.values()]


if __name__ == "__main__":
    main()
