"""The report of a run: one HTML file that contains everything, its scripts included, and opens without a network.

Bounded in size for any length of sequence: the slider shows at most 120 frames with 20 draws each, charts at most 600 frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics import verdicts
from poseppl.diagnostics.diagnosis import diagnosed, extension_of
from poseppl.diagnostics.efficiency import RHAT_SHARE, disagreement
from poseppl.diagnostics.modes import modes_over_time
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.verdicts.predictive import rank_test
from poseppl.diagnostics.verdicts.verdict import Verdict
from poseppl.errors import FilePath, Wording
from poseppl.files.atomic_writing import write_atomically
from poseppl.report.charts import charts, mode_chart
from poseppl.report.page import Extension, page_html
from poseppl.report.site_charts import MAX_ENTRIES, data_charts, site_charts
from poseppl.report.tables import ambiguity_table, cards, inefficiency_table, settings_table, worst_frames_table
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
    package = extension_of(whole, "report")
    own, more = package is None, Extension("") if package is None else package.extension(whole)
    modes = modes_over_time(whole) if more.modes is None else more.modes
    sites = {"data": data_charts(whole), "coordinates": site_charts(whole)} if own else {}
    besides: dict[str, Any] = {"modes": mode_chart(modes), **sites, **more.charts}
    drawn = charts(whole) | {title: each for title, each in besides.items() if each}
    apart = disagreement(whole["diagnostics"].dataset.get("rhat", np.nan))
    return page_html(
        "report.html",
        more.package,
        title=title_of(whole),
        subtitle=algorithms_of(whole),
        cards=cards(whole, more.cards),
        data={"charts-data": drawn} | dict(more.data),
        charts=drawn,
        found=[Verdict(each.severity, each.worded(name)) for each in verdicts(whole)],
        own=own,
        most_entries=MAX_ENTRIES,
        predicted="posterior_predictive" in whole.children,
        known="truth" in whole.children,
        weighted=is_weighted(whole),
        sampled=is_sampled(whole),
        uniform=float(whole["diagnostics"].dataset["tau"].max()),
        apart=apart if apart > RHAT_SHARE else 0.0,
        ranks=rank_test(whole),
        ambiguous=ambiguity_table(modes),
        by_coordinate=inefficiency_table(whole),
        worst=worst_frames_table(whole),
        settings=settings_table(whole),
        **more.content,
    )
