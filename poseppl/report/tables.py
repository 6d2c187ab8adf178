"""The tables of the report: coordinates, worst frames, modes, settings; and its headline numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.comparison import over_frames
from poseppl.diagnostics.efficiency import RHAT_SHARE, disagreement
from poseppl.diagnostics.modes import Modes, ambiguities
from poseppl.diagnostics.run_figures import figures_of_run, is_sampled
from poseppl.report.page import DASH, shown, with_error
from poseppl.runs.contents import FLAT, group_of
from poseppl.runs.results import is_weighted, provenance

MAX_ROWS, MAX_VALUES = 10, 30
Row = dict[str, Any]
Card = tuple[Any, str, str]
"""A headline number, or an array of which it is the mean; its format; and its label. None is shown of what is not finite."""


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
    """List what a coordinate's draws are worth, over the frames; nothing for weighted particles, whose coordinates are equal.

    The first are those in which chains disagree, by R-hat, where any do; then those of the largest inefficiency factor.
    """
    figures = figures_of_run(tree)
    if is_weighted(tree) or figures["tau"].isnull().all():
        return []
    moves = figures["tau"].notnull().any("frame").values
    moving = figures.isel(state_dim=moves)
    tau, parts = moving["tau"], xr.Dataset(over_frames(moving))
    parts = parts.assign(largest=tau.max("frame"), worst=tau.idxmax("frame"), least=moving["ess"].min("frame"))
    order = "rhat" if disagreement(moving["rhat"]) > RHAT_SHARE else "largest"
    rows = [row | {"tau": with_error(row["tau"], row["tau_se"])} for row in records(parts.sortby(-parts[order]))]
    names = figures["state_dim"].values[~moves]
    return rows + [dict.fromkeys(parts.data_vars, "fixed") | {"state_dim": name} for name in names]


def worst_frames_table(tree: xr.DataTree) -> Top:
    """List the frames that were sampled worst: largest inefficiency factor, ESS, rejection, divergences.

    Nothing for closed forms, nor where one frame is as the other.
    """
    data = tree["diagnostics"].dataset
    tau = data["tau"]
    if not is_sampled(tree) or tau.isnull().all() or (len(tau) > 1 and tau.max() == tau.min()):
        return Top([], 0)
    found = {"rejection": data.get("rejection_rate"), "divergences": group_of(tree, "sample_stats").get("divergences")}
    means = {} if is_weighted(tree) else {name: values for name, values in found.items() if values is not None}
    worst = data.get("tau_se", xr.full_like(tau, np.nan)).isel(state_dim=tau.fillna(-1).argmax("state_dim"))
    figures = xr.Dataset({"tau": tau.max("state_dim"), "tau_se": worst, "ess": data["ess"].min("state_dim")} | means)
    rows = records(figures.sortby(-figures["tau"]).isel(frame=slice(MAX_ROWS)))
    alike = {"state_dim": "all"} if is_weighted(tree) else {}
    return Top([row | {"tau": with_error(row["tau"], row["tau_se"])} | alike for row in rows], figures.sizes["frame"])


def ambiguity_table(modes: Modes) -> Top:
    """The stretches of frames that have several modes, the longest first."""
    end = int(modes.frames[-1]) + 1
    found = sorted(ambiguities(modes), key=lambda each: each.arose - (end if each.resolved is None else each.resolved))
    rows: list[Row] = [
        each._asdict() | {"resolved": "never" if each.resolved is None else str(each.resolved)} for each in found[:MAX_ROWS]
    ]
    return Top(rows, len(found))


def cards(tree: xr.DataTree, more: Sequence[Card] = ()) -> list[tuple[str, str]]:
    """List the headline numbers, those that the result has: first what draws are worth, R-hat before all if chains disagree.

    Args:
        tree: A diagnosed result.
        more: Numbers of an extension.
    """
    data, known, figures = tree["diagnostics"].dataset, provenance(tree), figures_of_run(tree)
    share, error = (data[name].sel(level=0.9) if name in data else np.nan for name in ("coverage", "coverage_se"))
    frames, seconds = known.get("frames_run", tree["posterior"].sizes["frame"]), number_of(known.get("wall_seconds"))
    worth = over_frames(figures, "state_dim")
    cost = "gradient" if np.isfinite(worth["ess_per_gradient"]) else "evaluation"
    found: list[Card] = [
        (worth["rhat"] if disagreement(figures["rhat"]) > RHAT_SHARE else None, "{:.2f}", "largest R-hat: the chains disagree"),
        (figures["tau"].median(), "{:.1f}", "median inefficiency factor τ"),
        (worth["ess_per_second"], "", "ESS per second"),
        (worth[f"ess_per_{cost}"], "", f"ESS per {cost}"),
        (None if is_weighted(tree) else 100 * data.get("rejection_rate", np.nan), "{:.0f} %", "proposals rejected"),
        (100 * share, f"{{:.0f}} ± {100 * float(error):.0f} %", "coverage of 90 % intervals (± SE)"),
        *more,
        (number_of(frames) / seconds if seconds > 0 else None, "{:.1f}", "frames per second"),
    ]
    means = [(np.nan if value is None else float(np.mean(value)), form, label) for value, form, label in found]
    return [(form.format(value) if form else shown(value), label) for value, form, label in means if np.isfinite(value)]


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


def number_of(value: Any) -> float:
    """A number of a result's provenance; NaN for anything else."""
    return float(value) if isinstance(value, int | float) else float("nan")
