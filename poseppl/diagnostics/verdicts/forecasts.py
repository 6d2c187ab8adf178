"""Whether forecasts from all frames hold the data that came, which needs no truth."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.coverage import COVERAGE_ERROR, LEVEL, calibration
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Verdict
from poseppl.runs.contents import group_of


def forecasts(tree: xr.DataTree) -> list[Verdict]:
    """Coverage of forecasts; nothing where the result has none of `poseppl.diagnostics.add_hindcasts`."""
    data = group_of(tree, "hindcasts")
    found = []
    for site in data["site"].values.tolist() if data else ():
        share, error = (float(data[name].sel(site=site)) for name in ("overall", "overall_se"))
        reach = float(data["overall_reach"].sel(site=site)) if "overall_reach" in data else 2 * error
        kind = calibration(share, reach / 2) if np.isfinite(share) else "undecided"
        if kind not in ("over-confident", "under-confident"):
            continue
        by_lead, leads = data["coverage"].sel(site=site).values, data["lead"].values
        worst = int(np.nanargmax(np.abs(by_lead - LEVEL)))
        text = (
            f"90 % intervals of forecasts of {site}, {leads[0]} to {leads[-1]} frames ahead, hold {100 * share:.0f} % "
            f"(± {100 * error:.0f}) of the data that came ({100 * by_lead[worst]:.0f} % {leads[worst]} ahead)"
        )
        if kind == "over-confident":
            severity = ERROR if share < COVERAGE_ERROR else WARNING
            found.append(Verdict(severity, f"{text}: the filter or the model's transition claims to know too much."))
        else:
            found.append(Verdict(WARNING, f"{text}: the model's transition or noise is wider than the data need."))
    return found
