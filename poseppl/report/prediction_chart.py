"""Histogram of the probability integral transforms of a run's predictive checks, which is flat where its predictions hold.

Bars high at both ends say that predictions are too narrow, a hump that they are too wide, a slope that they are biased
(Diebold, Gunther and Tay 1998, doi:10.2307/2527342). A bar's standard error is that of the share of a frame's data in its bin,
by batches of consecutive frames.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.batches import ratio_interval
from poseppl.diagnostics.selection import Array
from poseppl.report.chart import Chart, chart, line, points
from poseppl.report.picture import MUTED, POSTERIOR, SAMPLE
from poseppl.runs.contents import variable

BINS = 10


def prediction_chart(tree: xr.DataTree) -> Chart | None:
    """Draw the histogram; none where the result has no predictive checks."""
    transform = variable(tree, "predictive", "transform")
    if transform is None or not np.isfinite(transform).any():
        return None
    share, error = transform_shares(np.asarray(transform, np.float64))
    name, centres = "share of the data (± 2 standard errors)", (np.arange(BINS) + 0.5) / BINS
    bars = {"type": "bar", "width": 1 / BINS, "marker": {"color": SAMPLE, "line": {"color": "white", "width": 1}}}
    drawn = points(centres, 100 * share, name, POSTERIOR, 100 * error) | bars
    flat = {"color": MUTED, "width": 1, "dash": "dot"}
    ideal = line([0, 1], np.full(2, 100 / BINS), "predictions that hold", MUTED, line=flat, hoverinfo="skip")
    histogram = {key: value for key, value in drawn.items() if key not in ("mode", "line")}
    label = "place among the predicted data"
    return chart([histogram, ideal], "data (%)", xlabel=label, height=260, hovermode="closest", xaxis={"range": [0, 1]})


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
