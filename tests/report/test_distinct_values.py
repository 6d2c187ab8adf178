"""The figures of one result, each another, where they are printed and drawn: none is that of another level, root or unit."""

from __future__ import annotations

import numpy as np
import pytest
from distinct_values import ERRORS, SHARES, distinct_result

from poseppl.cli.outputs import summary
from poseppl.diagnostics import diagnose
from poseppl.motion.measures import image_grows_down, root_index
from poseppl.motion.report.sections import cards as cards_of_body, error_table, error_traces
from poseppl.motion.tracking.metrics import measure_run
from poseppl.report.charts import charts
from poseppl.report.tables import cards

TREE = distinct_result()


def test_the_numbers_of_a_run() -> None:
    found = measure_run(TREE)
    # means over the frames 0 to 5 and the markers: 10 (2.5 + 3) and 2 (2.5 + 3); the median of 1, 4 and 19; 5 frames in 2.5 s
    assert found.joint_error == pytest.approx(55.0)
    assert found.joint_error_relative == pytest.approx(11.0)
    assert (found.coverage, found.coverage_state) == (0.73, 0.83)
    assert found.rejection == pytest.approx(0.36)
    assert (found.tau, found.failed, found.frames_per_second) == (4.0, 2, 2.0)


def test_the_rows_of_the_command_line() -> None:
    rows = {name.strip(): value for name, value in summary(TREE)}
    expected = {
        "frames": "6, 2 impossible",
        "mean joint error": "55.0 mm",
        "relative to the pelvis": "11.0 mm",
        "coverage of 90 % intervals, joints": "73.0%",
        "of the coordinates": "83.0%",
        "rejection rate": "36.0%",
        "frames a second": "2.0",
        "compilation": "1.5 s",
    }
    assert {name: rows.get(name) for name in expected} == expected


def test_the_cards_of_the_report() -> None:
    shown = [big for big, _ in cards(TREE, cards_of_body(TREE))]
    # 77 effective draws in half a second
    assert shown[:6] == ["4.0", "154", "36 %", "83 ± 2 %", "55 mm", "11 mm"]


def test_errors_by_marker() -> None:
    """Means over the frames, 95 % quantiles of 0 to 5 above the first, and relative ones."""
    rows = {row["marker"]: [row[name] for name in ("mean", "high", "relative")] for row in error_table(TREE)}
    np.testing.assert_allclose(rows["knee"], [35.0, 57.5, 7.0])
    np.testing.assert_allclose(rows["pelvis"], [85.0, 107.5, 15.0])


def test_coverage_is_drawn_at_its_level_with_two_standard_errors() -> None:
    lines = {line["name"]: line for line in charts(TREE)["coverage"]["data"]}
    for label, name in (("state", "coverage"), ("markers", "coverage_markers")):
        line = lines[f"{label} (± 2 standard errors)"]
        np.testing.assert_allclose(line["x"], [50, 80, 90])
        np.testing.assert_allclose(line["y"], 100 * np.array(SHARES[name]))
        np.testing.assert_allclose(line["error_y"]["array"], 200 * np.array(ERRORS[name]))


def test_bands_are_the_central_ninety_percent() -> None:
    drawn, draws = charts(TREE), TREE["unconstrained_posterior/state"].values.reshape(16, 6, 3)
    low, high = (np.array([each["data"][end]["y"] for each in drawn["coordinates"].values()]) for end in (0, 1))
    np.testing.assert_allclose(low, np.quantile(draws, 0.05, axis=0).T, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(high, np.quantile(draws, 0.95, axis=0).T, rtol=1e-3, atol=1e-3)
    markers = TREE["posterior/markers"].values.reshape(16, 6, 3, 3)
    distance = np.linalg.norm(markers - markers.mean(0), axis=-1).mean(-1)
    lower, upper = (line["y"] for line in error_traces(TREE)[:2])
    np.testing.assert_allclose(upper, np.quantile(distance, 0.95, axis=0), rtol=1e-3)
    np.testing.assert_allclose(lower, np.quantile(distance, 0.05, axis=0), rtol=1e-3)


def test_images_grow_down_where_the_focal_length_does() -> None:
    assert [image_grows_down(TREE, camera) for camera in (0, 1)] == [False, True]


@pytest.mark.full
def test_errors_are_relative_to_the_named_root() -> None:
    """The posterior's mean is off by 5, 12 and 7 mm; beside the pelvis by the difference of two of these."""
    assert root_index(TREE) == 2
    data = diagnose(TREE)["diagnostics"].dataset
    np.testing.assert_allclose(data["joint_error"].mean("frame"), [5.0, 12.0, 7.0], rtol=1e-5)
    np.testing.assert_allclose(data["joint_error_relative"].mean("frame"), [np.hypot(3, 3), np.hypot(7, 12), 0.0], atol=1e-4)
