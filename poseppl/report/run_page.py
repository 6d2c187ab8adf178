"""The report of a run: one HTML file that contains everything, its scripts included, and opens without a network.

Bounded in size for any length of sequence: the slider shows at most 120 frames with 20 draws each, charts at most 600 frames.
"""

from __future__ import annotations

from typing import Any

import xarray as xr

from poseppl.diagnostics import verdicts
from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.diagnostics.doubts import doubts_of
from poseppl.diagnostics.image_errors import image_errors
from poseppl.diagnostics.modes import modes_over_time
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.verdicts.predictive import rank_test
from poseppl.diagnostics.verdicts.verdict import Verdict
from poseppl.errors import FilePath, Wording
from poseppl.files.atomic_writing import write_atomically
from poseppl.report.charts import charts, joint_charts, mode_chart, residual_chart
from poseppl.report.page import page_html
from poseppl.report.pose_data import doubts_shown, ghosts, pose_data
from poseppl.report.site_charts import MAX_ENTRIES, data_charts, site_charts
from poseppl.report.tables import (
    ambiguity_table,
    camera_table,
    cards,
    doubt_table,
    error_table,
    inefficiency_table,
    settings_table,
    worst_frames_table,
)
from poseppl.report.titles import algorithms_of, title_of
from poseppl.runs.results import is_weighted


def write_report(tree: xr.DataTree, path: FilePath, *, name: Wording = str) -> None:
    """Write the report of a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.
        path: The HTML file, overwritten if it exists; it appears when it is whole.
        name: How verdicts name the argument of a remedy; as in Python by default.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    write_atomically(path, report_html(tree, name))


def report_html(tree: xr.DataTree, name: Wording = str) -> str:
    """Make the report of a result, the whole page; see :func:`write_report`."""
    whole = diagnosed(tree)
    drawn, poses, modes = charts(whole), pose_data(whole), modes_over_time(whole)
    doubts, errors = doubts_of(whole), image_errors(whole)
    own = "body" not in whole.children
    besides: dict[str, Any] = {"data": data_charts(whole) if own else {}, "coordinates": site_charts(whole) if own else {}}
    besides |= {"modes": mode_chart(modes), "residuals": residual_chart(whole, errors), "joints": joint_charts(whole)}
    drawn |= {title: each for title, each in besides.items() if each}
    if poses is not None and poses["space"] is not None:
        poses["space"]["ghosts"] = ghosts(modes, poses["frames"])
        poses["space"]["doubts"] = doubts_shown(whole, doubts, poses["frames"])
    return page_html(
        "report.html",
        title=title_of(whole),
        subtitle=algorithms_of(whole),
        cards=cards(whole),
        data={"charts-data": drawn, "pose-data": poses},
        charts=drawn,
        poses=poses,
        found=[Verdict(each.severity, each.worded(name)) for each in verdicts(whole)],
        own=own,
        most_entries=MAX_ENTRIES,
        num_frames=whole["posterior"].sizes["frame"],
        predicted="posterior_predictive" in whole.children,
        known="truth" in whole.children,
        weighted=is_weighted(whole),
        sampled=is_sampled(whole),
        uniform=float(whole["diagnostics"].dataset["tau"].max()),
        ranks=rank_test(whole),
        errors=error_table(whole),
        ambiguous=ambiguity_table(modes),
        cameras=camera_table(whole, errors),
        doubted=doubt_table(whole, doubts),
        doubts=doubts,
        by_coordinate=inefficiency_table(whole),
        worst=worst_frames_table(whole),
        settings=settings_table(whole),
    )
