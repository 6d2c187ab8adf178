"""Coverage of the truth by intervals, predictions of points, frames without data, and silhouettes."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import provenance_table
from poseppl.diagnostics.verdicts.coverage import coverage_finding, coverage_of
from poseppl.diagnostics.verdicts.predictive import UNDER_CONFIDENT, prediction as of_any
from poseppl.diagnostics.verdicts.verdict import (
    ERROR,
    INFO,
    WARNING,
    Findings,
    Remedy,
    Verdict,
    array_of,
    not_run,
    settings_among,
    where,
)
from poseppl.motion.verdicts.steps import ANGLE, POSITION, in_one_camera, of_walk
from poseppl.runs.contents import group_of, names_of, variable
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


OVERLAP_LOW, OVERLAP_ERROR = 0.65, 0.5
"""Intersection over union of body and silhouettes, mean over a camera's frames: below it there is a warning, an error."""
OVERLAP_FRAME = 0.4
"""Intersection over union of a single frame, mean of its cameras, below which there is a warning."""
JUMP = 0.5
"""How far a silhouette's centre moves from a frame to the next, in units of the root of its area, before it is reported; a
person's
silhouette is some 0.75 m across by this measure. At least as far as `PACE` allows."""
PACE = 12.0
"""Roots of its area that a silhouette's centre moves in a second at most: 9 m/s."""
SWELLING = 1.6
"""Factor by which a silhouette's area grows or shrinks from a frame to the next before it is reported."""

_IN_MASKS = "check the masks for other people and furniture ({})"
_OF_OVERLAP = (
    *(Remedy(_IN_MASKS, argument) for argument in ("masks", "occlusion", "background")),
    Remedy("check {}", "facing"),
    Remedy("check {}", "stature"),
)


def overlap(tree: xr.DataTree) -> Findings:
    """A body that does not fill the silhouettes it was tracked in, by camera and frame."""
    share, cameras = group_of(tree, "sample_stats").get("overlap"), names_of(tree, "camera")
    if share is None or not np.isfinite(share).any():
        yield not_run()
        return
    means = share.mean("frame", dtype=np.float64).values
    frames = share.mean(set(share.dims) - {"frame"}, dtype=np.float64).values < OVERLAP_FRAME
    low = np.flatnonzero(means < OVERLAP_LOW)
    if not len(low) and not frames.any():
        return
    named = ", ".join(f"{cameras[i]} {means[i]:.2f}" for i in low) or "every camera well on average"
    worst = f", and below {OVERLAP_FRAME:g} in {where(tree, frames)}" if frames.any() else ""
    text = f"Body and silhouettes overlap too little ({named}; 1 is perfect{worst})"
    severity = ERROR if np.nanmin(means) < OVERLAP_ERROR or frames.mean() > 0.1 else WARNING
    yield Verdict(severity, f"{text}:", _OF_OVERLAP)


def silhouette_jumps(tree: xr.DataTree) -> Findings:
    """Silhouettes that leap or swell from a frame to the next, as when they change to another person; by camera."""
    area, centre = (array_of(tree, "observed_data", f"silhouette_{part}") for part in ("area", "centre"))
    if area is None or centre is None or len(area) < 2:
        yield not_run()
        return
    rate = float(tree.attrs.get("rate", np.inf))
    far = np.linalg.norm(np.diff(centre, axis=0), axis=-1) / np.sqrt(area[:-1])
    growth = np.abs(np.diff(np.log(area), axis=0))
    jumps = np.vstack([np.zeros(area.shape[1], bool), (far > max(JUMP, PACE / rate)) | (growth > np.log(SWELLING))])
    cameras = names_of(tree, "camera")
    found = [f"{cameras[i]} ({where(tree, jumps[:, i])})" for i in np.flatnonzero(jumps.any(axis=0))]
    if found:
        text = f"Silhouettes jump or change size suddenly in {', '.join(found)}: they may show another person;"
        yield Verdict(WARNING, text, (Remedy("look at the overlay, and give {} of one person", "masks"),))
