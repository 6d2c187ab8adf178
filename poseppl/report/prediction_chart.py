"""Histogram of the probability integral transforms of a run's predictive checks, which is flat where its predictions hold.

Bars high at both ends say that predictions are too narrow, a hump that they are too wide, a slope that they are biased
(Diebold, Gunther and Tay 1998, doi:10.2307/2527342). A bar's standard error is that of the share of a frame's data in its bin,
by batches of consecutive frames.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.batches import ratio_interval
from poseppl.diagnostics.selection import Array, variable
from poseppl.report.chart_parts import Chart, layout_of, line, plain
from poseppl.report.picture import MUTED, POSTERIOR, SAMPLE

BINS = 10


def prediction_chart(tree: xr.DataTree) -> Chart | None:
    """Draw the histogram.

    Args:
        tree: The result.

    Returns:
        The chart; None where the result has no predictive checks.
    """
    transform = variable(tree, "predictive", "transform")
    if transform is None or not np.isfinite(transform).any():
        return None
    share, error = transform_shares(np.asarray(transform, np.float64))
    centres, width = (np.arange(BINS) + 0.5) / BINS, 1 / BINS
    bars = {"type": "data", "array": plain(200 * error), "color": POSTERIOR, "thickness": 1.5}
    histogram = {
        "type": "bar",
        "x": plain(centres),
        "y": plain(100 * share),
        "width": width,
        "name": "share of the data (± 2 standard errors)",
        "marker": {"color": SAMPLE, "line": {"color": "white", "width": 1}},
        "error_y": bars,
    }
    flat = {"color": MUTED, "width": 1, "dash": "dot"}
    level = np.full(2, 100 / BINS)
    ideal = line([0, 1], level, "predictions that hold", MUTED, line=flat, hoverinfo="skip")
    layout = layout_of("data (%)", height=260, hovermode="closest")
    layout["xaxis"] = layout["xaxis"] | {"title": {"text": "place among the predicted data"}, "range": [0, 1]}
    return {"data": [histogram, ideal], "layout": layout}


def transform_shares(transform: Array) -> tuple[Array, Array]:
    """Share of the data in each bin, and its standard error (NaN where there are too few frames).

    Args:
        transform: (frame, entry), NaN where nothing was seen.
    """
    known = np.isfinite(transform)
    frames = known.any(axis=1)
    places = np.minimum(np.floor(np.where(known, transform, -1.0) * BINS), BINS - 1)
    seen = known.sum(axis=1)[frames].astype(float)
    found = [ratio_interval(((places == number) & known).sum(axis=1)[frames], seen) for number in range(BINS)]
    return np.array([each.estimate for each in found]), np.array([each.standard_error for each in found])
