"""Whether intervals cover the truth as often as they say, where it is known."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Verdict

_LEVEL = 0.9
_SLACK = 0.03


def coverage(tree: xr.DataTree) -> list[Verdict]:
    """Coverage of the 90 % intervals, where the truth is known."""
    data = tree["diagnostics"].dataset
    if "coverage" not in data:
        return []
    share, error = (float(data[name].sel(level=_LEVEL)) for name in ("coverage", "coverage_se"))
    if not np.isfinite(share):
        return []
    text = f"90 % intervals cover {100 * share:.0f} % (± {100 * error:.0f}) of the truth"
    if share + 2 * error < _LEVEL - _SLACK:
        advice = "over-confident, its intervals are too narrow"
        return [Verdict(ERROR if share < 0.75 else WARNING, f"{text}: {advice}.")]
    if share - 2 * error > _LEVEL + _SLACK:
        return [Verdict(WARNING, f"{text}: under-confident, its intervals are too wide.")]
    return [Verdict(INFO, f"{text}: calibrated as far as this sequence can tell.")]
