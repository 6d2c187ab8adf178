"""Ranks of simulation-based calibration as a picture: one histogram a coordinate, level where the posterior is right."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from poseppl.diagnostics.simulation_based import Calibration
from poseppl.report.picture import MUTED, POSTERIOR, new_picture, tidy

_BINS, _COLUMNS, _MOST = 10, 4, 24
_WIDTH = 2.6
"""Standard errors of a bar: 99 %."""


def plot_ranks(calibration: Calibration) -> Figure:
    """Draw the ranks' histograms of the first 24 coordinates, each bar with an interval of 99 % from the simulations' spread.

    Heaped at both ends the posterior is too narrow, in the middle too wide, at one end off to the other side.
    """
    number = min(len(calibration.names), _MOST)
    columns = min(number, _COLUMNS)
    rows = -(-number // columns)
    picture = new_picture(3.2 * columns, 2.4 * rows)
    picture.set_layout_engine("constrained")
    edges = np.linspace(0, 1, _BINS + 1)
    for index in range(number):
        axes = picture.add_subplot(rows, columns, index + 1)
        each = np.array([np.histogram(ranks, edges)[0] for ranks in calibration.ranks[..., index]])
        shares = each / each.sum(1, keepdims=True)
        error = _WIDTH * shares.std(0, ddof=1) / np.sqrt(len(shares))
        axes.bar(edges[:-1], shares.mean(0), 1 / _BINS, align="edge", color=POSTERIOR, alpha=0.55, yerr=error, ecolor=MUTED)
        axes.axhline(1 / _BINS, color=MUTED, linewidth=1.0)
        tidy(axes, calibration.names[index], "rank of the truth")
    return picture
