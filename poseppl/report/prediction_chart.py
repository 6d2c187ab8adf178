"""Histogram of the probability integral transforms of a run's predictive checks, which is flat where its predictions hold.

Bars high at both ends say that predictions are too narrow, a hump that they are too wide, a slope that they are biased
(Diebold, Gunther and Tay 1998, doi:10.2307/2527342). A bar's standard error is that of the share of a frame's data in its bin,
by batches of consecutive frames.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics.batches import ratio_interval
from poseppl.diagnostics.selection import Array
from poseppl.report.chart import DOTTED, bars, chart, line
from poseppl.report.picture import MUTED, POSTERIOR, SAMPLE
from poseppl.runs.contents import variable

BINS = 10


def prediction_chart(tree: xr.DataTree) -> go.Figure | None:
    """Draw the histogram; none where the result has no predictive checks."""
    transform = variable(tree, "predictive", "transform")
    if transform is None or not np.isfinite(transform).any():
        return None
    share, error = transform_shares(np.asarray(transform, np.float64))
    drawn = go.Bar(
        x=(np.arange(BINS) + 0.5) / BINS,
        y=100 * share,
        width=1 / BINS,
        name="share of the data (± 2 standard errors)",
        marker={"color": SAMPLE, "line": {"color": "white", "width": 1}},
        error_y=bars(200 * error, color=POSTERIOR),
    )
    ideal = line([0, 1], np.full(2, 100 / BINS), "predictions that hold", MUTED, **DOTTED)
    label = "place among the predicted data"
    return chart([drawn, ideal], "data (%)", xlabel=label, height=260, xaxis_range=[0, 1], hovermode="closest")


def transform_shares(transform: Array) -> tuple[Array, Array]:
    """Share of the data in each bin, and its standard error (NaN where there are too few frames).

    Args:
        transform: (frame, entry), NaN where nothing was seen.
    """
    places = np.minimum(np.floor(transform * BINS), BINS - 1)
    found = [ratio_interval(places == number, np.where(np.isfinite(transform), 1.0, np.nan)) for number in range(BINS)]
    return np.array([each.estimate for each in found]), np.array([each.standard_error for each in found])
