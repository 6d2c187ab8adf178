"""The tables of the report: coordinates, worst frames, errors, cameras, doubts, modes, settings; and its headline numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.doubts import Doubts, doubts_in_a_row
from poseppl.diagnostics.image_errors import ImageErrors
from poseppl.diagnostics.modes import Modes, ambiguities
from poseppl.diagnostics.selection import told
from poseppl.report.page import DASH
from poseppl.runs.contents import FLAT, group_of, names_of, variable
from poseppl.runs.results import is_weighted, provenance

MAX_ROWS, MAX_DOUBTS = 10, 15
Row = dict[str, Any]


def settings_table(tree: xr.DataTree) -> dict[str, list[str]]:
    """List what was run: every root attribute, nested settings one line each, and the sizes of the result."""
    sizes = tree[FLAT].sizes
    rows: dict[str, object] = {"frames": sizes["frame"]}
    if is_weighted(tree):
        rows["particles"] = f"{tree.attrs['num_particles']} ({sizes['draw']} draws kept)"
    else:
        rows["chains × draws kept"] = f"{sizes['chain']} × {sizes['draw']}"
    rows["degrees of freedom"] = sizes["dof"]
    if "rate" in tree.attrs:
        rows["frames a second of the recording"] = f"{float(tree.attrs['rate']):g}"
    return {name: [str(value)] for name, value in (rows | flatten(provenance(tree))).items()}


def inefficiency_table(tree: xr.DataTree) -> list[Row]:
    """List the inefficiency of each coordinate over the frames, the worst first; nothing for weighted particles."""
    data = tree["diagnostics"].dataset
    if is_weighted(tree) or data["tau"].isnull().all():
        return []
    moves = data["tau"].notnull().any("frame")
    moving = data.isel(dof=moves.values)
    tau = moving["tau"]
    figures = xr.Dataset(
        {
            "median": tau.median("frame"),
            "mean": tau.mean("frame"),
            "largest": tau.max("frame"),
            "worst": tau.idxmax("frame"),
            "windowed": moving["tau_windowed"].median("frame"),
            "ess": moving["ess"].min("frame"),
            "rhat": moving["rhat"].max("frame"),
        }
    )
    fixed = [{"dof": name} | dict.fromkeys(map(str, figures), "fixed") for name in data["dof"].values[~moves.values]]
    return records(figures.sortby(-figures["largest"])) + fixed


def worst_frames_table(tree: xr.DataTree) -> list[Row]:
    """List the frames that were sampled worst: largest inefficiency factor, ESS, rejection, divergences, joint error."""
    data = tree["diagnostics"].dataset
    tau = data["tau"]
    if tau.isnull().all():
        return []
    found = {"rejection": data.get("rejection_rate"), "divergences": group_of(tree, "sample_stats").get("divergences")}
    found = {"error": data.get("joint_error")} | ({} if is_weighted(tree) else found)
    means = {name: values.mean(set(values.dims) - {"frame"}) for name, values in found.items() if values is not None}
    figures = xr.Dataset({"tau": tau.max("dof"), "ess": data["ess"].min("dof")} | means)
    figures["coordinate"] = tau.fillna(-1).idxmax("dof") if not is_weighted(tree) else xr.full_like(tau[:, 0], "all", object)
    return records(figures.sortby(-figures["tau"]).isel(frame=slice(MAX_ROWS)))


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
    """A row a camera: what it saw, how far off, and how much its calibration was mended, where the result tells."""
    if errors is None:
        return []
    found, seen = told(tree, "cameras found"), np.isfinite(errors.distance)
    wrong_person, swaps = (variable(tree, "faults", part) for part in ("wrong_person", "swaps"))
    rows = []
    for c, (name, (right, down), spread) in enumerate(zip(errors.cameras, errors.bias, errors.spread, strict=True)):
        mine, noise = found.get(name), errors.noise[:, c][seen[:, c]]
        row: Row = {"camera": name, "points": seen[:, c].sum(), "noise": np.median(noise) if noise.size else np.nan}
        row |= {"spread": spread, "right": right, "down": down}
        if isinstance(mine, dict):
            row |= {key: _number(mine.get(key)) for key in ("turned", "moved", "agreement")}
        if swaps is not None and swaps.size:
            row["exchanged"] = (swaps[:, c] > 0.5).any(-1).sum()
        if wrong_person is not None and np.isfinite(wrong_person[:, c]).any():
            row["identity"] = 1 - np.nanmax(wrong_person[:, c])
        rows.append(row)
    columns = {key for row in rows for key in row}
    return [dict.fromkeys(columns, np.nan) | row for row in rows]


def doubt_table(tree: xr.DataTree, doubts: Doubts | None) -> list[Row]:
    """The doubts that weigh most."""
    rows = [] if doubts is None else doubts_in_a_row(tree, doubts)[:MAX_DOUBTS]
    return [each._asdict() | {"frames": f"{each.first}" + (f" to {each.last}" if each.num_frames > 1 else "")} for each in rows]


def ambiguity_table(modes: Modes) -> list[Row]:
    """The stretches of frames that have several modes, the longest first."""
    end = int(modes.frames[-1]) + 1
    found = sorted(ambiguities(modes), key=lambda each: each.arose - (end if each.resolved is None else each.resolved))
    return [
        each._asdict() | {"resolved": "never" if each.resolved is None else str(each.resolved)} for each in found[:MAX_ROWS]
    ]


def cards(tree: xr.DataTree) -> list[tuple[str, str]]:
    """List the headline numbers."""
    data, known = tree["diagnostics"].dataset, provenance(tree)
    shown: list[tuple[str, str]] = []
    if "joint_error" in data:
        shown.append((f"{float(data['joint_error'].mean()):.0f} mm", "mean joint error"))
        shown.append((f"{float(data['joint_error_relative'].mean()):.0f} mm", "relative to the root"))
    if "coverage" in data and np.isfinite(data["coverage"].values).all():
        share, error = (100 * float(data[name].sel(level=0.9)) for name in ("coverage", "coverage_se"))
        shown.append((f"{share:.0f} ± {error:.0f} %", "of the truth in 90 % intervals"))
    if data["tau"].notnull().any():
        shown.append((f"{float(data['tau'].median()):.1f}", "median inefficiency τ"))
    if "rejection_rate" in data and not is_weighted(tree):
        shown.append((f"{100 * float(data['rejection_rate'].mean()):.0f} %", "of proposals rejected"))
    stature = known.get("assumed stature")
    if (
        isinstance(stature, list)
        and len(stature) == 2
        and all(isinstance(each, int | float) and 0 < each < 1e4 for each in stature)
    ):
        shown.append((f"{stature[0] / 1000:.2f} ± {stature[1] / 1000:.2f} m", "stature, which is not known"))
    seconds = known.get("wall_seconds")
    if isinstance(seconds, int | float) and seconds > 0:
        shown.append((f"{tree['posterior'].sizes['frame'] / seconds:.1f}", "frames a second"))
    return shown


def records(figures: xr.Dataset) -> list[Row]:
    """Rows of figures of one dimension, by their names."""
    rows = figures.to_dataframe().reset_index().to_dict("records")
    return [{str(name): value for name, value in row.items()} for row in rows]


def flatten(value: Any, name: str = "") -> dict[str, str]:
    """Rows of nested settings, what is shown by name."""
    if isinstance(value, dict):
        found: dict[str, str] = {}
        for key, inner in value.items():
            found |= flatten(inner, f"{name} · {key}".removeprefix(" · ").replace("_", " "))
        return found
    if isinstance(value, float):
        return {name: f"{value:.6g}"}
    return {name: ", ".join(map(str, value)) if isinstance(value, list) else DASH if value is None else str(value)}


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")
