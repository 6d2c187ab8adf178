"""Whether the intervals of coordinates and joints cover the truth as often as they say."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import provenance_table
from poseppl.diagnostics.verdicts.coverage import coverage_finding, coverage_of
from poseppl.diagnostics.verdicts.verdict import Findings, Remedy, not_run, settings_among
from poseppl.motion.verdicts.remedies import ANGLE, POSITION, of_walk
from poseppl.runs.contents import variable
from poseppl.runs.results import provenance


def coverage(tree: xr.DataTree) -> Findings:
    """Coverage of the 90 % intervals of coordinates and joints."""
    shares = {"coordinates": coverage_of(tree, "coverage"), "joints": coverage_of(tree, "coverage_markers")}
    if not any(shares.values()):
        yield not_run("no truth")
    places = (Remedy("use {}", "markers", "learned"),) if _markers_may_be_learned(tree) else ()
    wider = Remedy("raise {}", "noise"), *of_walk(tree, "raise {}", ANGLE, POSITION)
    more = settings_among(tree, "num_updates", "num_draws", "num_particles")
    narrower = Remedy("lower {}", "noise"), *of_walk(tree, "lower {}", ANGLE, POSITION)
    for what, found in shares.items():
        if found:
            yield coverage_finding(found, what, (*places, *wider, *more), narrower, _of_body(tree) if what == "joints" else "")


def _of_body(tree: xr.DataTree) -> str:
    """Differences of a recording's joints from the model's body, which no interval includes."""
    residual = provenance(tree).get("residual_mm")
    if not isinstance(residual, int | float) or residual < 0.1:
        return ""
    return f" (they ignore that the body differs from the recording by {residual:.1f} mm)"


def _markers_may_be_learned(tree: xr.DataTree) -> bool:
    """Whether two cameras or more saw markers that were taken for where the body has them."""
    fixed = provenance_table(tree, "settings").get("markers") == "fixed"
    points = variable(tree, "observed_data", "points")
    return fixed and points is not None and points.shape[1] > 1 and bool(np.isfinite(points).any())
