"""Charts: one definition, drawn by the page and into pictures."""

from __future__ import annotations

import numpy as np
import pytest
from page_reading import decoded
from synthetic import synthetic_result, two_sided_result

from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.diagnostics.modes import modes_over_time
from poseppl.motion.report import plot_error
from poseppl.motion.report.pose_views import ghosts
from poseppl.motion.report.sections import error_traces
from poseppl.report.chart import Panel, fan, grid, line, log_axis, log_ticks, stack
from poseppl.report.charts import mode_chart
from poseppl.report.page import to_json
from poseppl.report.tables import Top, ambiguity_table

X = np.arange(3)


def test_short_arrays_are_short_numbers_and_what_is_not_finite_is_null() -> None:
    given = {"a": np.array([[1.23456789, np.nan], [-np.inf, 123456.7]]), "n": np.arange(2), "i": np.int64(3)}
    assert decoded(to_json(given)) == {"a": [[1.2346, None], [None, 123460.0]], "n": [0, 1], "i": 3}


def test_long_arrays_are_there_once_and_within_half_a_step() -> None:
    values = np.random.default_rng(0).normal(1000.0, 300.0, (40, 5, 3))
    values[3, 2, 1] = np.nan
    frames = np.arange(7, 47)
    text = to_json({"a": values, "again": values.copy(), "x": frames, "short": frames[:3]})
    assert len(text) < 2 * (4 / 3) * (values.size + frames.size) + 300
    read = decoded(text)
    found = np.array(read["a"], float)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(values))
    np.testing.assert_allclose(found, values, atol=0.51 * np.ptp(values[np.isfinite(values)]) / 65_534)
    assert read["again"] == read["a"] and read["x"] == frames.tolist() and read["short"] == [7, 8, 9]


def test_what_may_be_on_a_logarithmic_scale_keeps_five_figures() -> None:
    values = np.geomspace(1e-7, 1e3, 50)
    np.testing.assert_allclose(decoded(to_json({"y": values}))["y"], values, rtol=1e-4)


def test_pictures_draw_the_charts_of_the_page() -> None:
    tree = synthetic_result(num_frames=8)
    drawn = {trace["name"]: trace for trace in error_traces(diagnosed(tree))}
    axes = plot_error(tree).axes[0]
    lines = {str(shown.get_label()): shown.get_ydata() for shown in axes.get_lines()}
    assert set(lines) | {"expected error, central 90 %"} == set(drawn)
    for name, values in lines.items():
        np.testing.assert_allclose(values, drawn[name]["y"])
    lower, upper, _ = fan(X, (X - 1.0, X, X + 1.0))
    assert upper["fill"] == "tonexty" and not lower["showlegend"] and (upper["y"] > lower["y"]).all()


def test_panels_stand_in_rows_and_names_once_in_the_legend() -> None:
    panels = [Panel([line(X, X, "run", "#000000")], f"panel {number}") for number in range(3)]
    chart = grid(panels, columns=2, height=300)
    assert chart is not None
    assert [(trace["xaxis"], trace["yaxis"]) for trace in chart["data"]] == [("x", "y"), ("x2", "y2"), ("x3", "y3")]
    corners = [(chart["layout"][f"xaxis{n}"]["domain"][0], chart["layout"][f"yaxis{n}"]["domain"][1]) for n in ("", 2, 3)]
    assert corners[0][0] == corners[2][0] < corners[1][0] and corners[0][1] == corners[1][1] > corners[2][1]
    assert [trace["showlegend"] for trace in chart["data"]] == [True, False, False]
    assert [note["text"] for note in chart["layout"]["annotations"]] == ["panel 0", "panel 1", "panel 2"]
    shared = stack(panels, height=100)
    assert shared is not None and shared["layout"]["height"] == 360
    assert [shared["layout"][f"xaxis{n}"]["title"]["text"] for n in ("", 2, 3)] == [None, None, "frame"]
    assert shared["layout"]["xaxis"]["matches"] == shared["layout"]["xaxis2"]["matches"] == "x3"
    assert [shared["layout"][f"yaxis{n}"]["title"]["text"] for n in ("", 2, 3)] == ["panel 0", "panel 1", "panel 2"]
    assert grid([], columns=1, height=300) is None and stack([], height=100) is None


def test_ticks_of_logarithmic_axes() -> None:
    assert log_ticks(0.9, 40.0).tolist() == [1, 3, 10, 30]
    assert log_ticks(1.0, 1e6).tolist() == [10.0**power for power in range(7)]
    axis = log_axis("s", np.array([np.nan, -1.0, 0.0, 0.02, 4.0]))
    np.testing.assert_allclose(axis["range"], np.log10([0.01, 8.0]), rtol=1e-12)
    assert axis["ticktext"] == ["0.01", "0.03", "0.1", "0.3", "1", "3"]


@pytest.mark.full
def test_modes_are_shown_where_a_result_has_several() -> None:
    single = modes_over_time(synthetic_result(num_frames=8), of="markers")
    assert mode_chart(single) is None and ghosts(single, single.frames) is None and ambiguity_table(single) == Top([], 0)
    modes = modes_over_time(two_sided_result(), of="markers")
    drawn = mode_chart(modes)
    assert drawn is not None
    np.testing.assert_allclose(drawn["data"][1]["y"], np.where((modes.frames >= 16) & (modes.frames < 20), 25.0, 0.0))
    found = ghosts(modes, np.array([17, 21]))
    assert found is not None
    np.testing.assert_allclose(found["masses"], [[0.75, 0.25], [1.0, 0.0]])
    assert np.isnan(found["markers"][1, 1]).all() and np.isfinite(found["markers"][0]).all()
    ((row,), total) = ambiguity_table(modes)
    assert total == 1
    assert (row["arose"], row["resolved"], row["lesser"], row["place"]) == (16, "20", 0.25, "wrist_r")
    assert ghosts(modes._replace(means=modes.means[..., 0]), modes.frames) is None, "states are not drawn in space"
