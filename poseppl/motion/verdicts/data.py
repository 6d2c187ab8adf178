"""Predictions of points, and frames in which nothing was observed."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.predictive import UNDER_CONFIDENT, prediction as of_any
from poseppl.diagnostics.verdicts.verdict import INFO, WARNING, Findings, Remedy, Verdict, where
from poseppl.motion.verdicts.remedies import in_one_camera
from poseppl.runs.contents import group_of

MISSING_HIGH = 0.2


def prediction(tree: xr.DataTree) -> Findings:
    """One-step-ahead predictions; of keypoints in one camera none are called too wide."""
    narrow = in_one_camera(tree)
    yield from (each for each in of_any(tree) if not (narrow and UNDER_CONFIDENT in each.finding))


def missing(tree: xr.DataTree) -> Findings:
    """Frames in which nothing was observed; of silhouettes, those that show nobody, for their points are always missing."""
    observed = group_of(tree, "observed_data")
    name = next((name for name in ("silhouette_area", "points") if name in observed), None)
    if name is None:
        return
    values = observed[name].values
    blind = ~np.isfinite(values).reshape(len(values), -1).any(axis=1)
    if blind.any():
        text = f"Nothing was observed in {where(tree, blind)}: the posterior there is the prediction. To choose other frames,"
        yield Verdict(WARNING if blind.mean() > MISSING_HIGH else INFO, text, (Remedy("use {}", "frames"),))
