"""Inefficiency factors and R-hat of all frames and coordinates of a result beside ArviZ's functions, which loop over them.

python -m benchmarks.diagnostics [--quick] [--frames 80] [--dofs 28]
"""

from __future__ import annotations

from functools import partial

import numpy as np
from arviz_stats.base import array_stats
from scipy.signal import lfilter

from benchmarks.timing import arguments, interleave, show
from poseppl.diagnostics import inefficiency, split_rhat

SHAPES = {"4 chains of 250 draws": (4, 250), "20 chains of 50 draws": (20, 50)}


def main() -> None:
    options = arguments(__doc__, frames=80, dofs=28)
    frames = 4 if options.quick else options.frames
    rows = []
    for label, shape in SHAPES.items():
        noise = np.random.default_rng(0).standard_normal((*shape, frames, options.dofs))
        draws = lfilter([1.0], [1.0, -0.7], noise, axis=1)
        for name, own, rival in (
            ("ESS", inefficiency, partial(array_stats.ess, method="mean", relative=True)),
            ("R-hat", split_rhat, partial(array_stats.rhat, method="split")),
        ):
            rivals = {"own": partial(own, draws), "ArviZ": partial(rival, draws, chain_axis=0, draw_axis=1)}
            found = interleave(rivals, 1 if options.quick else 3)
            each, other = (1e6 * found[key].median / (frames * options.dofs) for key in ("own", "ArviZ"))
            rows.append([f"{name}, {label}", f"{each:.1f}", f"{other:.1f}", f"{other / each:.1f}"])
    show(f"{frames} frames, {options.dofs} coordinates", ["", "ours, µs each", "ArviZ, µs each", "ratio"], rows)


if __name__ == "__main__":
    main()
