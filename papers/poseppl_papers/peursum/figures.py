"""The figures of the experiment, drawn from its tables alone."""

from __future__ import annotations

from typing import Any

from poseppl.report.picture import new_picture
from poseppl_papers.experiment import Jobs, Pictures, Results, Tables
from poseppl_papers.images.figures import COLOURS
from poseppl_papers.peursum.dimensionality import EXACT, FILTER
from poseppl_papers.peursum.tables import DIFFUSIONS, sweep
from poseppl_papers.tables import Table


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
