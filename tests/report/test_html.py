from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from page_reading import data_of, decoded
from synthetic import synthetic_result

from poseppl.motion.report.pose_views import pose_data
from poseppl.report import report_html, write_report
from poseppl.report.page import to_json
from poseppl.runs.results import Names, build_result


@pytest.mark.full
def test_one_file_without_a_network(tmp_path: Path) -> None:
    write_report(synthetic_result(), tmp_path / "report.html")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)=[\"'](?!data:)", page)
    assert "Plotly" in page
    for heading in ("Verdicts", "Poses", "Error", "Coverage", "Mixing", "Coordinates", "Settings"):
        assert f"<h2>{heading}</h2>" in page


@pytest.mark.full
def test_text_of_the_user_is_escaped() -> None:
    page = report_html(synthetic_result())
    assert "<script>alert" not in page
    assert "<b>not bold" not in page
    assert "&lt;script&gt;alert(1)" in page


@pytest.mark.full
def test_provenance_and_verdicts_are_reported() -> None:
    page = report_html(synthetic_result(truth_scale=2.5, num_frames=40))
    assert "poseppl_models.synthetic:stick" in page
    assert "settings · num chains" in page
    assert "overconfident" in page


@pytest.mark.full
@pytest.mark.parametrize(
    "arguments",
    [
        {"weighted": True},
        {"with_truth": False},
        {"weighted": True, "with_truth": False},
        {"num_frames": 1},
        {"num_draws": 2},
        {"num_draws": 1, "num_chains": 1},
    ],
)
def test_every_kind_of_result_has_a_report(arguments: dict[str, int]) -> None:
    page = report_html(synthetic_result(**arguments))  # type: ignore[arg-type]
    charts = data_of(page, "charts-data")
    assert isinstance(charts, dict)
    assert ("coverage" in charts) == (arguments.get("with_truth", True) and arguments.get("num_draws") != 1)
    for name in charts:
        assert f'data-chart="{name}"' in page


def test_a_model_without_a_body_has_a_report() -> None:
    rng = np.random.default_rng(0)
    tree = build_result(state=rng.standard_normal((4, 20, 6, 2)), names=Names(("level", "slope")))
    page = report_html(tree)
    assert "<h1>Posterior of a state-space model</h1>" in page
    tree.attrs["model"] = '"a cart"'
    assert "<h1>a cart</h1>" in report_html(tree)
    assert 'id="pose-data"' not in page
    assert "<h2>Poses</h2>" not in page
    assert list(data_of(page, "charts-data")["coordinates"]) == ["level", "slope"]  # type: ignore[index]


@pytest.mark.full
def test_values_that_are_not_finite_become_null() -> None:
    tree = synthetic_result(num_frames=6)
    tree["posterior"]["markers"][0, 0, 2] = np.nan
    tree["sample_stats"]["log_evidence"][3] = -np.inf
    report_html(tree)


@pytest.mark.full
def test_size_is_bounded_on_long_sequences() -> None:
    poses = pose_data(synthetic_result(num_frames=1000, num_draws=8))
    assert poses is not None
    assert len(poses["frames"]) == 120
    assert poses["frames"][0] == 10
    assert poses["frames"][-1] == 1009
    assert len(poses["space"]["draws"][0]) == 20
    assert len(to_json(poses)) < 3_000_000


@pytest.mark.full
def test_rounding_keeps_the_poses() -> None:
    tree = synthetic_result(num_frames=5)
    poses = pose_data(tree)
    assert poses is not None
    shown = decoded(to_json(poses))
    np.testing.assert_allclose(shown["space"]["mean"], tree["summary/markers_mean"], atol=0.51)
    np.testing.assert_allclose(poses["space"]["truth"], tree["truth/markers"], atol=0.51)
    mean = tree["posterior/points"].values.mean(axis=(0, 1))
    np.testing.assert_allclose(poses["image"]["mean"], mean, atol=1e-3 * np.ptp(mean[..., 1]))
    seen = tree["observed_data/points"].values
    assert decoded(to_json(poses))["image"]["observed"][2][0][3] == [None, None]
    np.testing.assert_allclose(poses["image"]["observed"][0], seen[0], atol=1e-3 * np.ptp(mean[..., 1]))
