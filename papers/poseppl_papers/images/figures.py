"""Errors of filters on scenes, drawn."""

from __future__ import annotations

import numpy as np

from poseppl.report.picture import Picture, new_picture
from poseppl_papers.experiment import Jobs, Pictures, Results, Tables
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.tables import Table, grouped

COLOURS = ("#1f6f8b", "#e4572e", "#6b8f3c", "#8a5fa8", "#c58b1b", "#3f3f46", "#b3261e", "#2f9c95")
_FIGURES = {"absolute": "mean's error, mm", "relative": "relative to the pelvis, mm", "optimistic": "best particle's error, mm"}


def draw_errors(table: Table) -> Picture:
    """A panel for each figure: methods downwards, a mark for each system and scene, with the standard deviation over runs."""
    rows = [row for row in table.records() if row["method"][0] != "("]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    groups = grouped(rows, lambda row: (row["system"], row["scene"]))
    picture = new_picture(4.0 * len(_FIGURES), 1.6 + 0.22 * len(methods) * (1 + len(groups)))
    axes = picture.subplots(1, len(_FIGURES), sharey=True, squeeze=False)[0]
    for axis, (figure, label) in zip(axes, _FIGURES.items(), strict=True):
        for number, (group, mine) in enumerate(groups.items()):
            place = [methods.index(row["method"]) + 0.7 * (number + 0.5) / len(groups) for row in mine]
            spread = np.nan_to_num([row[f"{figure}_sd"] for row in mine])
            colour = COLOURS[number % len(COLOURS)]
            axis.errorbar([row[figure] for row in mine], place, xerr=spread, fmt="o", color=colour, label=", ".join(group))
            held = [row[figure] for row in table.records(method=HOLDING, system=group[0], scene=group[1])]
            if held and figure == "relative":
                axis.axvline(held[0], color=colour, linestyle=":", linewidth=1)
        axis.set(xlabel=label, ylim=(len(methods), 0))
        axis.set_xlim(left=0)
    axes[0].set_yticks(np.arange(len(methods)) + 0.35, methods)
    picture.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, fontsize=8)
    return picture


def draw_scenes(table: Table) -> Picture:
    """A panel for each figure: systems and methods downwards, a mark for each scene, and a bar at their mean."""
    groups = grouped(table.records(), lambda row: (row["system"], row["method"]))
    picture = new_picture(4.0 * len(_FIGURES) + 2.0, 1.0 + 0.45 * len(groups))
    axes = picture.subplots(1, len(_FIGURES), sharey=True, squeeze=False)[0]
    for axis, (figure, label) in zip(axes, _FIGURES.items(), strict=True):
        for number, rows in enumerate(groups.values()):
            values = [row[figure] for row in rows]
            axis.plot(values, np.full(len(values), number), "o", color=COLOURS[0], alpha=0.5, label="a walk, mean of its runs")
            axis.plot([np.mean(values)] * 2, [number - 0.3, number + 0.3], color=COLOURS[1], linewidth=2, label="mean of walks")
        axis.set(xlabel=label, ylim=(len(groups) - 0.5, -0.5))
        axis.set_xlim(left=0)
    axes[0].set_yticks(np.arange(len(groups)), [": ".join(group) for group in groups])
    handles, labels = axes[0].get_legend_handles_labels()
    picture.legend(handles[:2], labels[:2], loc="outside upper center", ncols=2, fontsize=8)
    return picture


def drawn_scenes(name: str, tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """That figure of a table, in the file of its name."""
    return {f"{name}.png": draw_scenes(tables[name])}


def drawn_errors(name: str, tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """That figure of a table, in the file of its name."""
    return {f"{name}.png": draw_errors(tables[name])}
