"""The report of a run: one HTML file that holds everything, its scripts included, and opens without a network.

Bounded in size for any length of sequence: the slider shows at most 120 frames with 20 draws each, charts at most 600 frames.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from html import escape
from os import PathLike

import xarray as xr
from matplotlib.figure import Figure

from poseppl.diagnostics import verdicts
from poseppl.diagnostics.selection import diagnosed, has_chains
from poseppl.files.atomic_writing import atomic_path
from poseppl.report.chains import plot_autocorrelation, plot_trace
from poseppl.report.charts import charts, coordinate_data
from poseppl.report.picture import png
from poseppl.report.pose_data import pose_data
from poseppl.report.shell import Section, page_html
from poseppl.report.tables import cards, error_table, inefficiency_table, provenance_table, worst_frames_table
from poseppl.runs.results import is_weighted, provenance


def write_report(tree: xr.DataTree, path: str | PathLike[str]) -> None:
    """Write the report of a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.
        path: The HTML file, overwritten if it exists; it appears when it is whole.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    page = report_html(tree)
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="replace")


def report_html(tree: xr.DataTree) -> str:
    """Make the report of a result.

    Args:
        tree: The result.

    Returns:
        The whole page.
    """
    whole = diagnosed(tree)
    drawn, poses = charts(whole), pose_data(whole)
    sections = [
        Section("verdicts", "Verdicts", _verdicts(whole)),
        Section("poses", "Poses", _poses(poses)),
        Section(
            "truth",
            "Error and coverage" if "error" in drawn and "truth" in whole.children else "Uncertainty",
            _truth(whole, set(drawn)),
        ),
        Section("mixing", "Particles" if is_weighted(whole) else "Mixing", _mixing(whole, set(drawn))),
        Section("progress", "Frame by frame", _progress(set(drawn))),
        Section("predictions", "Predictions", _predictions(set(drawn))),
        Section("coordinates", "Coordinates", _coordinates(whole)),
        Section("run", "What was run", provenance_table(whole)),
    ]
    known = provenance(whole)
    return page_html(
        str(known.get("input", "Tracking")),
        " · ".join(str(known[name]) for name in ("model", "filter", "created") if name in known),
        sections,
        cards=cards(whole),
        data={"charts-data": drawn, "pose-data": poses, "coordinate-data": coordinate_data(whole)},
        script="page.js",
    )


def _image(plot: Callable[[xr.DataTree], Figure], tree: xr.DataTree, text: str) -> str:
    data = base64.b64encode(png(plot(tree), dpi=110)).decode("ascii")
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{data}">'


def _verdicts(tree: xr.DataTree) -> str:
    items = "".join(f'<li class="{escape(found.severity)}">{escape(found.text)}</li>' for found in verdicts(tree))
    return f'<ul class="verdicts">{items}</ul>'


def _poses(poses: dict[str, object] | None) -> str:
    if poses is None:
        return ""
    frames, image = poses["frames"], poses["image"]
    names = image["cameras"] if isinstance(image, dict) else []
    options = "".join(f'<option value="{i}">{escape(str(name))}</option>' for i, name in enumerate(names))
    hidden = "" if len(names) > 1 else " hidden"
    shown = ('<div><div id="image" class="picture"></div></div>' if image else "") + (
        '<div><div id="space" class="picture"></div></div>' if poses["space"] else ""
    )
    layout = ' class="columns"' if image and poses["space"] else ""
    count = len(frames) if isinstance(frames, list) else 0
    return (
        '<p class="note">The image with the observed markers, and the body in space: the posterior mean, some draws '
        "around it, and the truth in black where it is known. Drag to turn; a click into a chart below comes here.</p>"
        f'<div class="controls"><button id="play" type="button">Play</button><input id="slider" type="range" min="0" '
        f'max="{count - 1}" value="0" step="1" aria-label="frame"><output id="frame"></output>'
        f'<select id="camera" aria-label="camera"{hidden}>{options}</select></div><div{layout}>{shown}</div>'
    )


def _truth(tree: xr.DataTree, drawn: set[str]) -> str:
    if "error" not in drawn and "coverage" not in drawn:
        return ""
    known = "truth" in tree.children
    note = (
        "The shaded band is the error that the posterior itself expects, the distance of its draws from its mean: where the "
        "posterior is calibrated, 90 % of the errors lie in it."
        if known
        else "Distance of the draws of the posterior from its mean, averaged over the markers; the truth is not known."
    )
    error = '<div><div id="chart-error"></div></div>' if "error" in drawn else ""
    cover = '<div><div id="chart-coverage"></div></div>' if "coverage" in drawn else ""
    layout = ' class="columns wide"' if error and cover else ""
    detail = error_table(tree)
    return f'<p class="note">{note}</p><div{layout}>{error}{cover}</div>' + (f"<h3>By marker</h3>{detail}" if detail else "")


def _mixing(tree: xr.DataTree, drawn: set[str]) -> str:
    if is_weighted(tree):
        note = "Weighted particles: τ is the number of particles over their effective number, the same for every coordinate."
        return f'<p class="note">{note}</p>{worst_frames_table(tree)}'
    note = (
        "τ draws of a chain are worth one independent draw of the posterior: one over the relative effective sample size "
        "for the mean; the windowed estimate beside it has no floor."
    )
    parts = [f'<p class="note">{note}</p>']
    if "inefficiency" in drawn:
        parts.append('<div id="chart-inefficiency"></div>')
        parts.append(f"<h3>By coordinate</h3>{inefficiency_table(tree)}")
        parts.append(f"<h3>Worst frames</h3>{worst_frames_table(tree)}")
    if has_chains(tree):
        parts.append(f"<h3>Autocorrelation where it is worst</h3>{_image(plot_autocorrelation, tree, 'autocorrelation')}")
        parts.append(f"<h3>Traces where mixing is worst</h3>{_image(plot_trace, tree, 'traces of the chains')}")
        parts.append('<p class="note">One colour a chain; the dashed line is the truth, where it is known.</p>')
    return "".join(parts)


def _progress(drawn: set[str]) -> str:
    return '<div id="chart-progress"></div>' if "progress" in drawn else ""


def _predictions(drawn: set[str]) -> str:
    note = (
        "Where each frame's data fell among what the filter expected before it saw them: flat where filter and model are "
        "right, high at both ends where the filter trusts itself too much, a hump where noise or steps are too wide."
    )
    return f'<p class="note">{note}</p><div id="chart-predictions"></div>' if "predictions" in drawn else ""


def _coordinates(tree: xr.DataTree) -> str:
    names = [str(name) for name in tree["posterior"].dataset["dof"].values]
    options = "".join(f'<option value="{i}">{escape(name)}</option>' for i, name in enumerate(names))
    select = f'<div class="controls"><select id="coordinate" aria-label="coordinate">{options}</select></div>'
    return f'{select}<div id="coordinate-chart"></div>'
