"""Tables and figures of the experiment, and how its page tells them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from poseppl.report.picture import new_picture
from poseppl_papers.experiment import Jobs, Pictures, Results, Tables
from poseppl_papers.images.tables import COLOURS, filter_rows, told_errors
from poseppl_papers.images.tracking import FIGURES, Tracking
from poseppl_papers.measured import Measured, over_runs
from poseppl_papers.peursum.dimensionality import EXACT, FILTER
from poseppl_papers.peursum.mixtures import DEFAULT, PUBLISHED
from poseppl_papers.peursum.plan import PUBLISHED_EXPONENT
from poseppl_papers.runs import joined
from poseppl_papers.tables import Table, grouped, markdown, rows_of

DIFFUSIONS = {"peursum": "published", "peursum-measured": "measured"}
PLAIN, ANNEALED = "Simple-PF", "Simple-APF"
"""First words of both filters' names."""


def exponent_table(jobs: Sequence[Tracking], results: Results) -> Table:
    """One row a run, without the frame where it starts; the annealed filter has no exponent."""
    columns = ("diffusion", "scene", "frames", "filter", "exponent", "run", *FIGURES, "ess_share", "seconds")
    rows: list[tuple[Any, ...]] = []
    for job in jobs:
        exponent = dict(job.system.settings).get("exponent", PUBLISHED_EXPONENT)
        text = "" if job.method.name.startswith(ANNEALED) else f"{exponent:g}"
        found = {name: values[:, 1:] for name, values in joined([job], results).items() if values.ndim > 1}
        for index, run in enumerate(job.runs):
            errors = [float(value) for value in found["errors"][index].mean(0)]
            cost = float(found["ess_share"][index].mean()), float(np.median(found["seconds"][index]))
            rows.append((job.system.name, job.scene.name, job.num_frames, job.method.name, text, run, *errors, *cost))
    about = "Plain filter over lambda and annealed filter, one row a run: errors in mm, mean ESS / N, seconds a frame (median)."
    return Table("exponents", columns, rows, about)


def trackers(tables: Tables) -> str:
    """Errors of the filters, with two diffusions."""
    rows = [
        [DIFFUSIONS[row["system"]], row["method"], *told_errors(row), f"{row['seconds']:.2g}", str(row["runs"])]
        for row in filter_rows(tables, "trackers")
    ]
    columns = ("diffusion", "filter", "error", "relative", "best particle", "s a frame", "runs")
    return markdown(columns, rows)


def sweep(tables: Tables, diffusion: str, column: str) -> dict[str, Measured]:
    """A column of the sweep over lambda, by "annealed" or lambda, the least first."""

    def name_of(row: Mapping[str, Any]) -> str:
        return "annealed" if row["filter"].startswith(ANNEALED) else f"{float(row['exponent']):g}"

    groups = grouped(rows_of(tables, "exponents", diffusion=diffusion), name_of)
    order = sorted(groups, key=lambda name: float("inf") if name == "annealed" else float(name))
    return {name: over_runs([row[column] for row in groups[name]]) for name in order}


def exponents(tables: Tables) -> str:
    """Errors and ESS / N of the plain filter over lambda, beside the annealed one."""
    names = {row["filter"].startswith(ANNEALED): row["filter"] for row in rows_of(tables, "exponents")}
    rows = []
    for system, diffusion in DIFFUSIONS.items():
        columns = [sweep(tables, system, name) for name in ("absolute", "relative", "optimistic", "ess_share")]
        for name in columns[0]:
            filter = names[True] if name == "annealed" else f"{names[False]}, lambda = {name}"
            ess = "" if name == "annealed" else f"{columns[3][name].mean:.2g}"
            shown = (each[name].text() for each in columns[:3])
            rows.append([diffusion, filter, *shown, ess, str(columns[0][name].runs)])
    return markdown(("diffusion", "filter", "error", "relative", "best particle", "ESS / N", "runs"), rows)


def dimensionality(tables: Tables) -> str:
    """Errors of the smoother as a share of the filter's."""
    if "dimensionality" not in tables:
        return ""
    share = {(row["dimension"], row["particles"]): row for row in tables["dimensionality"].records()}
    counts = sorted({size for _, size in share if size != EXACT})
    rows = [
        [f"d = {d}", *(told_share(share[d, size]) if (d, size) in share else "" for size in (*counts, EXACT))] for d in (1, 3)
    ]
    return markdown(("N", *(f"{count:,}" for count in counts), EXACT), rows)


def told_share(row: dict[str, Any]) -> str:
    """A share, with its standard error where it has one."""
    value, error = row["share"], row["share_standard_error"]
    return f"{value:.3f}" if np.isnan(error) else f"{value:.3f} ± {error:.3f}"


def mixtures(tables: Tables) -> str:
    """Cost of a mixture in place of the likelihood."""
    if "mixtures" not in tables:
        return ""
    rows = tables["mixtures"].records()
    error = {row["smoother"]: row["error"] for row in rows}
    shown = [[row["smoother"], f"{row['error']:.2f}", f"{row['variance']:.2f}"] for row in rows]
    times = error[PUBLISHED] / error[DEFAULT]
    text = f"The mixture that is not divided makes the smoothed means {times:.1f} times as wrong as the one that is."
    return f"{markdown(('smoother', 'error', 'variance'), shown)}\n\n{text}"


def draw_exponents(tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """Error of the plain filter over lambda, with its standard deviation over runs; a band is the annealed filter's."""
    picture = new_picture(5.5, 4.0)
    axis = picture.subplots()
    for colour, (system, diffusion) in zip(COLOURS, DIFFUSIONS.items(), strict=False):
        error = sweep(tables, system, "absolute")
        annealed = error.pop("annealed")
        sharpness = [float(name) for name in error]
        mean, spread = [each.mean for each in error.values()], [each.spread for each in error.values()]
        axis.errorbar(sharpness, mean, spread, fmt="o-", color=colour, capsize=3, label=f"plain, {diffusion} diffusion")
        axis.axhline(annealed.mean, color=colour, linestyle="--", label=f"annealed, {diffusion} diffusion")
        band = annealed.mean - annealed.spread, annealed.mean + annealed.spread
        axis.axhspan(*band, color=colour, alpha=0.15, linewidth=0)
    axis.set(xscale="log", xlabel="lambda", ylabel="mean's error, mm")
    axis.legend(fontsize=8)
    return {"exponents.png": picture}


def draw_dimensionality(tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """Fig. 14: errors above, ratios to the filter below; one column a dimension, dotted lines for the exact means."""
    table = tables["smoothers"]
    dimensions = sorted({row[0] for row in table.rows})
    picture = new_picture(5.0 * len(dimensions), 7.0)
    axes = picture.subplots(2, len(dimensions), squeeze=False)
    for column, dimension in enumerate(dimensions):
        for axis, figure in zip(axes[:, column], ("error", "share"), strict=True):
            _curves(axis, table, dimension, figure)
        axes[0, column].set(title=f"{dimension}-dimensional", ylabel="RMSE")
        axes[1, column].set(xlabel="particles", ylabel="smoothed / filtered")
    axes[0, -1].legend(fontsize=8)
    return {"dimensionality.png": picture}


def _curves(axis: Any, table: Table, dimension: int, figure: str) -> None:
    rows = table.records(dimension=dimension)
    error = "standard_error" if figure == "error" else "share_standard_error"
    for number, method in enumerate(dict.fromkeys(row["method"] for row in rows if row["particles"] != EXACT)):
        mine = [row for row in rows if row["method"] == method and row["particles"] != EXACT]
        values = ([row[name] for row in mine] for name in ("particles", figure, error))
        if not (figure == "share" and method == FILTER):
            axis.errorbar(*values, color=COLOURS[number], label=method, capsize=3)
    for row in rows:
        if row["particles"] == EXACT:
            axis.axhline(row[figure], linestyle=":", color="gray")
    axis.set(xscale="log")
