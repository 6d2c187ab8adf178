"""Silhouettes: whether the body fills them, and whether they stay with one person."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Remedy, Verdict, array_of, not_run, where
from poseppl.runs.contents import group_of, names_of

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
