"""The tables of the report: what was run, inefficiency of each coordinate, worst frames, errors; and its headline numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.report.page import DASH, Rows
from poseppl.runs.contents import frame_numbers, variable
from poseppl.runs.results import is_weighted, provenance

MAX_WORST = 10
_OF_CHAINS = ("rejection_rate", "divergences")


def settings_table(tree: xr.DataTree) -> Rows:
    """List what was run: every root attribute, nested settings one line each, and the sizes of the result."""
    posterior = tree["posterior"]
    sizes = posterior.sizes
    rows: list[tuple[str, object]] = [("frames", sizes["frame"])]
    if is_weighted(tree):
        rows.append(("particles", f"{tree.attrs['num_particles']} ({sizes['draw']} draws kept)"))
    else:
        rows.append(("chains × draws kept", f"{sizes['chain']} × {sizes['draw']}"))
    rows.append(("degrees of freedom", sizes["dof"]))
    if "rate" in tree.attrs:
        rows.append(("frames a second of the recording", f"{float(tree.attrs['rate']):g}"))
    for name, value in provenance(tree).items():
        rows.extend(flatten(name.replace("_", " "), value))
    return Rows(("", ""), list(rows))


def inefficiency_table(tree: xr.DataTree) -> Rows:
    """List the inefficiency of each coordinate over the frames, the worst first; nothing for weighted particles."""
    data = tree["diagnostics"].dataset
    if is_weighted(tree) or np.isnan(data["tau"].values).all():
        return Rows((), [])
    frames, names = frame_numbers(tree), data["dof"].values
    tau, windowed, ess, rhat = (np.asarray(data[name].values) for name in ("tau", "tau_windowed", "ess", "rhat"))
    rows: list[tuple[Any, ...]] = []
    for dof in np.argsort(-np.nan_to_num(tau, nan=-1).max(axis=0), kind="stable"):
        if np.isnan(tau[:, dof]).all():
            rows.append((names[dof], *["fixed"] * 7))
            continue
        worst = int(np.nanargmax(tau[:, dof]))
        measures = (np.nanmedian(tau[:, dof]), np.nanmean(tau[:, dof]), tau[worst, dof])
        largest = f"{np.nanmax(rhat[:, dof]):.2f}" if np.isfinite(rhat[:, dof]).any() else DASH
        rest = (f"{np.nanmedian(windowed[:, dof]):.1f}", f"{np.nanmin(ess[:, dof]):.0f}", largest)
        rows.append((names[dof], *(f"{measure:.1f}" for measure in measures), frames[worst], *rest))
    head = ("coordinate", "τ median", "τ mean", "τ largest", "in frame", "τ windowed", "least ESS", "largest R-hat")
    return Rows(head, rows)


def worst_frames_table(tree: xr.DataTree) -> Rows:
    """List the frames that were sampled worst: largest inefficiency factor, ESS, rejection, divergences, joint error."""
    tau, frames = variable(tree, "diagnostics", "tau"), frame_numbers(tree)
    if tau is None or np.isnan(tau).all():
        return Rows((), [])
    score = np.nan_to_num(tau, nan=-1).max(axis=1)
    names = tree["posterior"].dataset["dof"].values
    columns: list[tuple[str, Any, str]] = []
    for title, group, name, form in (
        ("least ESS", "diagnostics", "ess", "{:.1f}"),
        ("rejection", "diagnostics", "rejection_rate", "{:.0%}"),
        ("divergences", "sample_stats", "divergences", "{:.0f}"),
        ("joint error, mm", "diagnostics", "joint_error", "{:.0f}"),
    ):
        values = variable(tree, group, name)
        if values is not None and np.isfinite(values).any() and not (is_weighted(tree) and name in _OF_CHAINS):
            flat = values if values.ndim == 1 else (values.min(axis=1) if name == "ess" else values.mean(axis=1))
            columns.append((title, flat, form))
    rows = []
    for frame in np.argsort(-score, kind="stable")[:MAX_WORST]:
        worst = "all" if is_weighted(tree) else names[int(np.nan_to_num(tau[frame], nan=-1).argmax())]
        rows.append((frames[frame], f"{score[frame]:.1f}", worst, *(form.format(values[frame]) for _, values, form in columns)))
    return Rows(("frame", "τ largest", "coordinate", *(title for title, _, _ in columns)), rows)


def error_table(tree: xr.DataTree) -> Rows:
    """List the error of each marker over the frames, absolute and relative to the root; nothing without a truth."""
    error, relative = variable(tree, "diagnostics", "joint_error"), variable(tree, "diagnostics", "joint_error_relative")
    if error is None or relative is None:
        return Rows((), [])
    columns = {str(name): (error[:, i], relative[:, i]) for i, name in enumerate(tree["diagnostics"].dataset["marker"].values)}
    rows = [
        (name, f"{all_.mean():.0f}", f"{np.quantile(all_, 0.95):.0f}", f"{beside.mean():.0f}")
        for name, (all_, beside) in [*columns.items(), ("all", (error, relative))]
    ]
    return Rows(("marker", "error, mm", "95 % of frames below", "relative to the root, mm"), rows)


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
    tau = np.asarray(data["tau"].values)
    if np.isfinite(tau).any():
        shown.append((f"{np.nanmedian(tau):.1f}", "median inefficiency τ"))
    if "rejection_rate" in data and not is_weighted(tree):
        shown.append((f"{100 * float(data['rejection_rate'].mean()):.0f} %", "of proposals rejected"))
    seconds = known.get("wall_seconds")
    if isinstance(seconds, int | float) and seconds > 0:
        shown.append((f"{tree['posterior'].sizes['frame'] / seconds:.1f}", "frames a second"))
    return shown


def flatten(name: str, value: object) -> list[tuple[str, object]]:
    """Rows of a nested setting, as (name, what is shown)."""
    if isinstance(value, dict):
        return [row for key, inner in value.items() for row in flatten(f"{name} · {str(key).replace('_', ' ')}", inner)]
    if isinstance(value, float):
        return [(name, f"{value:.6g}")]
    if isinstance(value, list):
        return [(name, ", ".join(str(part) for part in value))]
    return [(name, DASH if value is None else value)]
