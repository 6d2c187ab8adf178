"""Charts: one definition, drawn by the page and into pictures."""

from __future__ import annotations

import json

import numpy as np
from synthetic import synthetic_result

from poseppl import report
from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.report.chart import Panel, band, grid, line, log_ticks
from poseppl.report.charts import charts
from poseppl.report.page import to_json

X = np.arange(3)


def test_numbers_of_a_page_are_short_and_what_is_not_finite_is_null() -> None:
    given = {"a": np.array([[1.23456789, np.nan], [-np.inf, 123456.7]]), "n": np.arange(2), "i": np.int64(3)}
    assert json.loads(to_json(given)) == {"a": [[1.2346, None], [None, 123460.0]], "n": [0, 1], "i": 3}


def test_pictures_draw_the_charts_of_the_page() -> None:
    tree = synthetic_result(num_frames=8)
    drawn = {trace["name"]: trace for trace in charts(diagnosed(tree))["error"]["data"]}
    axes = report.plot_error(tree).axes[0]
    lines = {str(shown.get_label()): shown.get_ydata() for shown in axes.get_lines()}
    assert set(lines) | {"posterior expects (90 %)"} == set(drawn)
    for name, values in lines.items():
        np.testing.assert_allclose(values, drawn[name]["y"])
    lower, upper = band(X, X - 1.0, X + 1.0, "band")
    assert upper["fill"] == "tonexty" and not lower["showlegend"] and (upper["y"] > lower["y"]).all()


def test_panels_stand_in_rows_and_names_once_in_the_legend() -> None:
    panels = [Panel([line(X, X, "run", "#000000")], f"panel {number}") for number in range(3)]
    chart = grid(panels, columns=2, height=300)
    assert chart is not None
    assert chart["layout"]["grid"]["subplots"] == [["xy", "x2y2"], ["x3y3", ""]]
    assert [trace["showlegend"] for trace in chart["data"]] == [True, False, False]
    assert [note["text"] for note in chart["layout"]["annotations"]] == ["panel 0", "panel 1", "panel 2"]
    shared = grid(panels, columns=1, height=300, shared=True)
    assert shared is not None and shared["layout"]["grid"]["subplots"] == [["xy"], ["xy2"], ["xy3"]]
    assert grid([], columns=1, height=300) is None


def test_ticks_of_logarithmic_axes() -> None:
    assert log_ticks(0.9, 40.0).tolist() == [1, 3, 10, 30]
    assert log_ticks(1.0, 1e6).tolist() == [10.0**power for power in range(7)]
