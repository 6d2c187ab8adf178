"""The tables of a body: errors by marker, cameras, joints of low confidence; and its headline numbers."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import provenance_table
from poseppl.motion.verdicts.doubts import Doubts, doubts_in_a_row
from poseppl.motion.verdicts.image_errors import ImageErrors
from poseppl.report.tables import Card, Row, Top, number_of
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import provenance

MAX_DOUBTS = 15


def cards(tree: xr.DataTree) -> list[Card]:
    """List the headline numbers of a body, those that the result has."""
    stature = provenance(tree).get("assumed stature")
    tall, unsure = map(number_of, stature) if isinstance(stature, list) and len(stature) == 2 else (np.nan, np.nan)
    given = 0 < tall < 1e4 and 0 < unsure < 1e4
    error, relative = (variable(tree, "diagnostics", name) for name in ("joint_error", "joint_error_relative"))
    return [
        (error, "{:.0f} mm", "mean joint error"),
        (relative, "{:.0f} mm", "mean joint error relative to the root"),
        (tall / 1000 if given else None, f"{{:.2f}} ± {unsure / 1000:.2f} m", "assumed stature (± SD)"),
    ]


def error_table(tree: xr.DataTree) -> list[Row]:
    """List the error of each marker over the frames, absolute and relative to the root; nothing without a truth."""
    error, relative = variable(tree, "diagnostics", "joint_error"), variable(tree, "diagnostics", "joint_error_relative")
    if error is None or relative is None:
        return []
    parts = [*zip(names_of(tree, "marker"), error.T, relative.T, strict=True), ("all", error, relative)]
    return [
        {"marker": name, "mean": each.mean(), "high": np.quantile(each, 0.95), "relative": beside.mean()}
        for name, each, beside in parts
    ]


def camera_table(tree: xr.DataTree, errors: ImageErrors | None) -> list[Row]:
    """A row a camera: its data, their errors, and the correction of its calibration, if the result has these."""
    if errors is None:
        return []
    found, seen = provenance_table(tree, "cameras found"), np.isfinite(errors.distance)
    wrong_person, swaps = (variable(tree, "faults", part) for part in ("wrong_person", "swaps"))
    rows = []
    for c, (name, (right, down), spread) in enumerate(zip(errors.cameras, errors.bias, errors.spread, strict=True)):
        mine, noise = found.get(name), errors.noise[:, c][seen[:, c]]
        row: Row = {"camera": name, "points": seen[:, c].sum(), "noise": np.median(noise) if noise.size else np.nan}
        row |= {"spread": spread, "right": right, "down": down}
        if isinstance(mine, dict):
            row |= {key: number_of(mine.get(key)) for key in ("turned", "moved", "agreement")}
        if swaps is not None and swaps.size:
            row["exchanged"] = (swaps[:, c] > 0.5).any(-1).sum()
        if wrong_person is not None and np.isfinite(wrong_person[:, c]).any():
            row["identity"] = 1 - np.nanmax(wrong_person[:, c])
        rows.append(row)
    columns = {key for row in rows for key in row}
    return [dict.fromkeys(columns, np.nan) | row for row in rows]


def doubt_table(tree: xr.DataTree, doubts: Doubts | None) -> Top:
    """The doubts that weigh most."""
    found = [] if doubts is None else doubts_in_a_row(tree, doubts)
    rows: list[Row] = [
        each._asdict()
        | {
            "joint": ", ".join(each.joints),
            "frames": f"{each.first}" + (f" to {each.last}" if each.num_frames > 1 else ""),
        }
        for each in found[:MAX_DOUBTS]
    ]
    return Top(rows, len(found))
