"""Whether intervals cover the truth as often as they say, where it is known, and forecasts the data that came.

The share of a sequence has a standard error, which is large where the sequence is short. A run is over- or under-confident if
two standard errors do not reach from its share to 90 %, and the two differ by more than two points: quantiles of some hundred
draws are off by so much. Else it is calibrated if two standard errors are at most five points, and undecided if they are more.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Findings, Remedy, Verdict, not_run, settings_among
from poseppl.runs.contents import group_of
from poseppl.runs.results import provenance

Calibration = Literal["over-confident", "under-confident", "calibrated", "undecided"]

LEVEL = 0.9
NEGLIGIBLE = 0.02
"""Deviation from the level that does not count."""
PRECISE = 0.05
"""Largest reach of the interval, two standard errors, of a share that is called calibrated."""
WIDE = 0.95
"""Share up to which intervals that are too wide need no warning."""
COVERAGE_ERROR = 0.8
"""Share below which over-confidence is an error: one true value in five lies outside, instead of one in ten."""


def calibration(share: float, standard_error: float) -> Calibration:
    """Judge a share of the truth inside 90 % intervals.

    Args:
        share: The share.
        standard_error: Its standard error.
    """
    reach = 2 * standard_error
    if abs(share - LEVEL) > max(NEGLIGIBLE, reach):
        return "over-confident" if share < LEVEL else "under-confident"
    return "calibrated" if reach <= PRECISE else "undecided"


def coverage(tree: xr.DataTree) -> Findings:
    """Coverage of the 90 % intervals of coordinates."""
    found = coverage_of(tree, "coverage")
    if found is None:
        yield not_run("no truth")
    else:
        yield coverage_finding(found, "coordinates", settings_among(tree, "num_updates", "num_draws", "num_particles"))


def coverage_of(tree: xr.DataTree, name: str) -> tuple[float, float] | None:
    """The share of the truth in 90 % intervals and its standard error; None where they are not known."""
    data = group_of(tree, "diagnostics")
    found = [float(data[each].sel(level=LEVEL)) for each in (name, f"{name}_se") if name in data]
    return (found[0], found[1]) if found and np.isfinite(found[0]) else None


def coverage_finding(
    found: tuple[float, float], what: str, wider: Sequence[Remedy], narrower: Sequence[Remedy] = (), aside: str = ""
) -> Verdict:
    """Judge the coverage of 90 % intervals.

    Args:
        found: :func:`coverage_of` them.
        what: The quantity, in words.
        wider: Remedies that make them wider.
        narrower: Remedies that make them narrower.
        aside: Another cause of narrow intervals, in words.
    """
    share, error = found
    kind = calibration(share, error)
    text = f"The coverage of 90 % intervals of {what} is {100 * share:.0f} % (± {100 * error:.0f})"
    if kind == "over-confident":
        severity = ERROR if share < COVERAGE_ERROR else WARNING
        return Verdict(severity, f"{text}: overconfident, intervals are too narrow{aside}:", tuple(wider))
    if kind == "under-confident" and share <= WIDE:
        return Verdict(INFO, f"{text}: slightly too wide.")
    if kind == "under-confident":
        return Verdict(WARNING, f"{text}: underconfident, intervals are too wide{':' if narrower else '.'}", tuple(narrower))
    tail = "calibrated" if kind == "calibrated" else "compatible with 90 %, but the sequence is too short to decide"
    return Verdict(INFO, f"{text}: {tail}.")


def forecasts(tree: xr.DataTree) -> Findings:
    """Coverage of forecasts; nothing where the result has none of `poseppl.diagnostics.add_hindcasts`."""
    data = group_of(tree, "hindcasts")
    if not data:
        yield not_run("" if "smoother" in provenance(tree) else "no hindcasts")
    for site in data["site"].values.tolist() if data else ():
        here = data.sel(site=site)
        share, error = float(here["overall"]), float(here["overall_se"])
        reach = float(here.get("overall_reach", 2 * error))
        kind = calibration(share, reach / 2) if np.isfinite(share) else "undecided"
        if kind in ("calibrated", "undecided"):
            continue
        by_lead, leads = here["coverage"].values, here["lead"].values
        worst = int(np.nanargmax(np.abs(by_lead - LEVEL)))
        text = (
            f"The coverage of 90 % intervals of forecasts of {site}, {leads[0]} to {leads[-1]} frames ahead, is "
            f"{100 * share:.0f} % (± {100 * error:.0f}; {100 * by_lead[worst]:.0f} % at {leads[worst]} frames)"
        )
        if kind == "over-confident":
            severity = ERROR if share < COVERAGE_ERROR else WARNING
            yield Verdict(severity, f"{text}: the filter or the model's transition is overconfident.")
        else:
            yield Verdict(WARNING, f"{text}: the variance of the model's transition or noise is too large.")
