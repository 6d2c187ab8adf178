"""Tables, cards and titles of the pages, by small results made by hand."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import xarray as xr
from page_reading import data_of
from synthetic import synthetic_result

from poseppl.diagnostics.diagnosis import diagnose
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.motion.report.sections import cards as cards_of_body, doubt_table
from poseppl.motion.verdicts.doubts import doubts_of
from poseppl.report import plot_track, report_html
from poseppl.report.charts import algorithms_of, charts, inefficiency_panel, short_names, title_of, wrapped
from poseppl.report.page import Cell, filled
from poseppl.report.tables import Top, cards, flatten, worst_frames_table
from poseppl.runs.results import Names, build_result


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        ("/data/walk.bvh", "walk.bvh"),
        ("/data/pose/cam1, /data/pose/cam4", "cam1, cam4"),
        ("/data/cam1/points.json, /data/cam2/points.json", "cam1/points.json, cam2/points.json"),
        ("/a/x.json, /a/x.json", "x.json, x.json"),
        ("built-in walk", "built-in walk"),
        (", ".join(f"/data/c{k}" for k in range(6)), "c0, c1, c2, c3 and 2 more"),
    ],
)
def test_titles_name_files_by_what_tells_them_apart(paths: str, names: str) -> None:
    assert short_names(paths) == names


def test_titles_of_results() -> None:
    tree = synthetic_result(num_frames=2)
    tree.attrs |= {"input": json.dumps("/long/path/to/cam1, /long/path/to/cam2"), "smoother": json.dumps("laplace")}
    assert title_of(tree) == "cam1, cam2" and algorithms_of(tree) == "stick · hmc filter · laplace"
    del tree.attrs["input"]
    assert title_of(tree) == "stick"
    assert len(short_names("/a/" + 200 * "x" + ".json")) <= 60 and short_names("/a/" + 200 * "x" + ".json").endswith(".json")
    lines = wrapped(" ".join(["word"] * 100), 40).splitlines()
    assert len(lines) == 2 and max(map(len, lines)) <= 40 and lines[1].endswith(" …")


def test_the_title_of_a_picture_stays_on_it() -> None:
    tree = synthetic_result(num_frames=3)
    tree.attrs["input"] = json.dumps(", ".join(f"/a/very/long/path/to/the/folder/of/camera_{k}_{'x' * 40}" for k in range(2)))
    picture = plot_track(tree)
    picture.draw_without_rendering()
    box = picture._suptitle.get_window_extent()  # type: ignore[attr-defined]
    assert box.x0 >= 0 and box.x1 <= picture.bbox.width


def closed_form() -> xr.DataTree:
    """A Kalman filter's result, which has draws, but no error of draws."""
    tree = synthetic_result(num_frames=12, weighted=True, sample_stats={"ess": np.linspace(500, 1000, 12)})
    tree.attrs["closed form"] = "true"
    return diagnose(tree)


def test_closed_forms_have_no_figures_of_sampling() -> None:
    tree, sampled = closed_form(), diagnose(synthetic_result(num_frames=12, weighted=True))
    assert not is_sampled(tree) and is_sampled(sampled)
    assert worst_frames_table(tree) == Top([], 0)
    assert inefficiency_panel(tree).missing and not inefficiency_panel(tree).traces
    drawn, others = ([axis.title.text for axis in charts(each)["progress"].select_yaxes()] for each in (tree, sampled))
    assert drawn == ["log evidence"] and others == ["log evidence", "effective number", "unique ancestors"]
    assert "median inefficiency factor τ" not in dict(map(reversed, cards(tree)))  # type: ignore[arg-type]
    assert dict(map(reversed, cards(sampled)))["median inefficiency factor τ"] == "1.2"  # type: ignore[arg-type]


@pytest.mark.full
def test_closed_forms_have_no_section_of_particles() -> None:
    assert "<h2>Particles</h2>" not in report_html(closed_form())
    assert "τ = 1.2 in every frame" in report_html(synthetic_result(num_frames=12, weighted=True))


def test_worst_frames_are_the_first_of_all() -> None:
    ess = np.full(24, 800.0)
    ess[7] = 10.0
    found = worst_frames_table(diagnose(synthetic_result(weighted=True, sample_stats={"ess": ess})))
    assert len(found.rows) == 10 and found.total == 24
    assert found.rows[0]["frame"] == 17 and found.rows[0]["tau"] == "100"


def test_cards_without_a_figure_are_left_out() -> None:
    tree = diagnose(build_result(state=np.zeros((2, 1, 3, 1)), names=Names(("level",))))
    assert cards(tree) == []
    tree.attrs |= {"wall_seconds": "1.5", "assumed stature": "[1700, 60]"}
    assert cards(tree, cards_of_body(tree)) == [("1.70 ± 0.06 m", "assumed stature (± SD)"), ("2.0", "frames per second")]
    unknown = diagnose(synthetic_result(num_frames=3))
    unknown["diagnostics"]["joint_error"][:] = np.nan
    assert "mean joint error" not in [label for _, label in cards(unknown, cards_of_body(unknown))]


def test_columns_without_a_figure_are_left_out() -> None:
    columns = [(name, name, "") for name in ("run", "some", "none", "dashes", "absent")]
    rows = [
        {"run": Cell("a"), "some": np.nan, "none": np.nan, "dashes": Cell("–")},
        {"run": Cell("b"), "some": 1.0, "none": np.nan},
    ]
    assert [title for title, *_ in filled(columns, rows)] == ["run", "some"]


def test_settings_are_words_and_short() -> None:
    found = flatten({"matrix": [[1.0, 2.0]] * 3, "on": True, "list": [0.1 + 0.2, "a"], "zero": -0.0, "no": None, "empty": []})
    assert found == {"matrix": "3 × 2 values", "on": "yes", "list": "0.3, a", "zero": "0", "no": "–", "empty": "none"}
    assert flatten(list(range(100)), "frames")["frames"].endswith("28, 29 and 70 more")


def spans_of_low_confidence() -> xr.DataTree:
    """A wrist that is far away in every third of 60 frames, in a draw of each chain, and a root that is known."""
    tree = synthetic_result(num_frames=60)
    markers = tree["posterior/markers"].values
    markers -= markers[:, :, :, :1]
    markers[:, 0, ::3, 5] += 9e3
    return tree


def test_rows_beyond_the_first_are_counted() -> None:
    tree = spans_of_low_confidence()
    found = doubt_table(tree, doubts_of(tree))
    assert len(found.rows) == 15 and found.total == 21, "in one frame two joints are unseen"
    assert {row["joint"] for row in found.rows} == {"wrist_l"} and found.rows[0]["frames"] in map(str, range(10, 70, 3))


@pytest.mark.full
def test_rows_that_are_not_shown_are_reported() -> None:
    page = report_html(spans_of_low_confidence())
    section = page[page.index('<section id="trust">') :].split("</section>")[0]
    assert len(re.findall("<tr><td", section)) == 15 and "15 of 21 rows, the most severe first." in section
    assert data_of(page, "pose-data")["space"]["doubts"]["words"]
