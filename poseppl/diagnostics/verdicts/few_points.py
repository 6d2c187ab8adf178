"""Whether so few points carry the past that their Monte Carlo error makes intervals too narrow."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.few_points import few_points_inflation
from poseppl.diagnostics.predictive import implied_coverage
from poseppl.diagnostics.verdicts.particles import suited_filter
from poseppl.diagnostics.verdicts.predictive import INFLATION_HIGH, prediction_of
from poseppl.diagnostics.verdicts.verdict import ERROR, Verdict, settings_among
from poseppl.runs.results import provenance


def few_points(tree: xr.DataTree) -> list[Verdict]:
    """Errors that the number of points alone explains, of filters that tell it; none without predictive checks of the state."""
    known, prediction = provenance(tree), prediction_of(tree)
    points = known.get("points of the past")
    if points is None or prediction is None or prediction.explained is None or "smoother" in known:
        return []
    found = few_points_inflation(prediction, tree["summary"].dataset["state_sd"].values, points)
    shares = [implied_coverage(each) for each in found[np.isfinite(found)]]
    if not shares or np.mean(shares) >= implied_coverage(INFLATION_HIGH):
        return []
    ways = [f"raise {settings_among(tree, 'num_chains')}", *(f"use {other}" for other in suited_filter(tree))]
    return [
        Verdict(
            ERROR,
            f"{points} points carry the past from frame to frame: by their Monte Carlo error alone, 90 % intervals cover at "
            f"most about {100 * np.mean(shares):.0f} %; {', or '.join(ways)}.",
        )
    ]
