"""A learned prior: whether the motion is what was learned."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import INFO, WARNING, Verdict, array_of, where

HOLDS = 0.5
"""Probability of the learned activity below which a frame is of other motion."""
OTHER_SHARE = 0.1
"""Share of such frames above which there is a warning."""


def learned_prior(tree: xr.DataTree) -> list[Verdict]:
    """Frames in which something else than the learned activity happens, by the posterior probability of the two."""
    probability = array_of(tree, "summary", "prior_mean")
    if probability is None or not (probability < HOLDS).any():
        return []
    other = probability < HOLDS
    share = float(np.mean(other))
    text = f"What was learned does not hold in {share:.0%} of the frames ({where(tree, other)}): there angles move at random"
    if share <= OTHER_SHARE:
        return [Verdict(INFO, f"{text}.")]
    advice = "learn from motion of this kind (poseppl fit-motion), or track without --prior"
    return [Verdict(WARNING, f"{text}. Better: {advice}.")]
