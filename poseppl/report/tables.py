"""The tables of the report: coordinates, worst frames, errors, cameras, doubts, modes, settings; and its headline numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.doubts import Doubts, doubts_in_a_row
from poseppl.diagnostics.image_errors import ImageErrors
from poseppl.diagnostics.modes import Modes, ambiguities
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.selection import told
from poseppl.report.page import DASH
from poseppl.runs.contents import FLAT, group_of, names_of, variable
from poseppl.runs.results import is_weighted, provenance

MAX_ROWS, MAX_DOUBTS, MAX_VALUES = 10, 15, 30
Row = dict[str, Any]


class Top(NamedTuple):
    """The first rows of a table, the most severe ones, and how many there are in all."""

    rows: list[Row]
    total: int


def settings_table(tree: xr.DataTree) -> dict[str, list[str]]:
    """List what was run: every root attribute, nested settings one line each, and the sizes of the result."""
    sizes = tree[FLAT].sizes
    rows: dict[str, object] = {"frames": sizes["frame"]}
    if is_weighted(tree):
        rows["particles"] = f"{tree.attrs['num_particles']} ({sizes['draw']} draws kept)"
    else:
        rows["chains × draws kept"] = f"{sizes['chain']} × {sizes['draw']}"
    rows["degrees of freedom"] = sizes["state_dim"]
    if "rate" in tree.attrs:
        rows["frame rate, frames per second"] = f"{float(tree.attrs['rate']):g}"
    return {name: [str(value)] for name, value in (rows | flatten(provenance(tree))).items()}


def inefficiency_table(tree: xr.DataTree) -> list[Row]:
    """List the inefficiency of each coordinate over the frames, the worst first; nothing for weighted particles."""
    data = tree["diagnostics"].dataset
    if is_weighted(tree) or not is_sampled(tree) or data["tau"].isnull().all():
        return []
    moves = data["tau"].notnull().any("frame")
    moving = data.isel(state_dim=moves.values)
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
    fixed = [
        {"state_dim": name} | dict.fromkeys(map(str, figures), "fixed") for name in data["state_dim"].values[~moves.values]
    ]
    return records(figures.sortby(-figures["largest"])) + fixed


def worst_frames_table(tree: xr.DataTree) -> Top:
    """List the frames that were sampled worst: largest inefficiency factor, ESS, rejection, divergences, joint error.

    Nothing for closed forms, nor where one frame is as the other.
    """
    data = tree["diagnostics"].dataset
    tau = data["tau"]
    if not is_sampled(tree) or tau.isnull().all() or (len(tau) > 1 and tau.max() == tau.min()):
        return Top([], 0)
    found = {"rejection": data.get("rejection_rate"), "divergences": group_of(tree, "sample_stats").get("divergences")}
    found = {"error": data.get("joint_error")} | ({} if is_weighted(tree) else found)
    means = {name: values.mean(set(values.dims) - {"frame"}) for name, values in found.items() if values is not None}
    figures = xr.Dataset({"tau": tau.max("state_dim"), "ess": data["ess"].min("state_dim")} | means)
    figures["coordinate"] = (
        tau.fillna(-1).idxmax("state_dim") if not is_weighted(tree) else xr.full_like(tau[:, 0], "all", object)
    )
    return Top(records(figures.sortby(-figures["tau"]).isel(frame=slice(MAX_ROWS))), figures.sizes["frame"])


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


def ambiguity_table(modes: Modes) -> Top:
    """The stretches of frames that have several modes, the longest first."""
    end = int(modes.frames[-1]) + 1
    found = sorted(ambiguities(modes), key=lambda each: each.arose - (end if each.resolved is None else each.resolved))
    rows: list[Row] = [
        each._asdict() | {"resolved": "never" if each.resolved is None else str(each.resolved)} for each in found[:MAX_ROWS]
    ]
    return Top(rows, len(found))


def cards(tree: xr.DataTree) -> list[tuple[str, str]]:
    """List the headline numbers, those that the result has."""
    data, known = tree["diagnostics"].dataset, provenance(tree)
    share, error = (data[name].sel(level=0.9) if name in data else np.nan for name in ("coverage", "coverage_se"))
    stature, seconds = known.get("assumed stature"), _number(known.get("wall_seconds"))
    tall, unsure = map(_number, stature) if isinstance(stature, list) and len(stature) == 2 else (np.nan, np.nan)
    given, frames = 0 < tall < 1e4 and 0 < unsure < 1e4, _number(known.get("frames_run", tree["posterior"].sizes["frame"]))
    found = [
        (data.get("joint_error"), "{:.0f} mm", "mean joint error"),
        (data.get("joint_error_relative"), "{:.0f} mm", "mean joint error relative to the root"),
        (100 * share, f"{{:.0f}} ± {100 * float(error):.0f} %", "coverage of 90 % intervals (± SE)"),
        (data["tau"].median() if is_sampled(tree) else None, "{:.1f}", "median inefficiency factor τ"),
        (None if is_weighted(tree) else 100 * data.get("rejection_rate", np.nan), "{:.0f} %", "proposals rejected"),
        (tall / 1000 if given else None, f"{{:.2f}} ± {unsure / 1000:.2f} m", "assumed stature (± SD)"),
        (frames / seconds if seconds > 0 else None, "{:.1f}", "frames per second"),
    ]
    means = [(np.nan if value is None else float(np.mean(value)), form, label) for value, form, label in found]
    return [(form.format(value), label) for value, form, label in means if np.isfinite(value)]


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
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return {name: f"{len(value)} × {max(map(len, value))} values"}
    if isinstance(value, list):
        more = f" and {len(value) - MAX_VALUES} more" if len(value) > MAX_VALUES else ""
        return {name: (", ".join(map(_word, value[:MAX_VALUES])) or "none") + more}
    return {name: _word(value)}


def _word(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return DASH if value is None else f"{value + 0.0:.6g}" if isinstance(value, float) else str(value)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")
