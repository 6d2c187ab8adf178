"""Whether a filter claims to learn of coordinates what no data tell it, which needs no truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.diagnostics.predictive import implied_coverage
from poseppl.diagnostics.unreached import unreached_figures
from poseppl.diagnostics.verdicts.predictive import INFLATION_HIGH, OVER_CONFIDENT, prediction_of
from poseppl.diagnostics.verdicts.verdict import ERROR, Verdict, statistic
from poseppl.runs.contents import names_of
from poseppl.runs.predictive import Prediction
from poseppl.runs.results import provenance

MAX_NAMED = 4


def unreached(tree: xr.DataTree) -> list[Verdict]:
    """Coordinates that the data hardly reach; nothing where the result has no predictive checks of its state."""
    prediction, ess = prediction_of(tree), statistic(tree, "ess")
    if "smoother" in provenance(tree):  # whose posterior knows more than the prediction's data
        return []
    if prediction is None or prediction.explained is None or ess is None:
        return []
    summary = tree["summary"].dataset
    return check_unreached(prediction, summary["state_mean"].values, summary["state_sd"].values, ess, names_of(tree, "dof"))


def check_unreached(
    prediction: Prediction, mean: ArrayLike, standard_deviation: ArrayLike, ess: ArrayLike, names: Sequence[str]
) -> list[Verdict]:
    """Judge a filter where its data hardly reach.

    Args:
        prediction: With a leading T.
        mean: The posterior's mean (T, d).
        standard_deviation: Its standard deviation (T, d).
        ess: The filter's effective number of draws (T,).
        names: Of the coordinates (d,).

    Returns:
        A finding; none where the posterior is what the prediction allows, or where there are too few frames to tell.
    """
    figures = unreached_figures(prediction, mean, standard_deviation, ess)
    if figures is None:
        return []
    found, error, reach = figures.inflation
    if not (np.isfinite(reach) and found > INFLATION_HIGH and found - reach > 1):
        return []
    which = np.flatnonzero(figures.coordinates)
    more = f" and {len(which) - MAX_NAMED} more" if len(which) > MAX_NAMED else ""
    return [
        Verdict(
            ERROR,
            f"In coordinates that the data hardly reach ({', '.join(names[i] for i in which[:MAX_NAMED])}{more}), errors have "
            f"{found:.2g} ± {error:.1g} times the variance that the filter claims: it gives {100 * figures.lost:.0f} % of the "
            f"predicted variance away in a frame, and data can tell {max(0.0, 100 * figures.explained):.0f} %; 90 % intervals "
            f"cover about {100 * implied_coverage(found):.0f} %. {OVER_CONFIDENT}",
        )
    ]
