from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from synthetic import EDGES, synthetic_result

from poseppl import report
from poseppl.diagnostics.selection import evenly
from poseppl.diagnostics.simulation_based import Calibration
from poseppl.motion import report as of_bodies
from poseppl.motion.measures import expected_error, segments
from poseppl.motion.report import plot_overlay, plot_pose3d
from poseppl.runs.results import Names, build_result


@pytest.mark.full
@pytest.mark.parametrize(
    "arguments", [{}, {"weighted": True}, {"with_truth": False}, {"num_frames": 1}, {"num_draws": 1, "num_chains": 1}]
)
def test_the_summary_picture_of_every_kind_of_result(tmp_path: Path, arguments: dict[str, Any]) -> None:
    report.save_picture(report.plot_track(synthetic_result(**arguments)), tmp_path / "track.png")
    pixels = np.asarray(Image.open(tmp_path / "track.png").convert("L"), float)
    assert pixels.shape[1] > 1000
    assert 0.01 < (pixels < 200).mean() < 0.5


@pytest.mark.full
def test_a_result_without_a_body_has_a_picture() -> None:
    tree = build_result(state=np.random.default_rng(0).standard_normal((4, 20, 6, 1)), names=Names(("level",)))
    assert len(report.plot_track(tree)._repr_png_()) > 5000  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="no points"):
        plot_overlay(tree)
    with pytest.raises(ValueError, match="no markers"):
        plot_pose3d(tree)


@pytest.mark.full
@pytest.mark.parametrize("name", ["overlay", "pose3d", "inefficiency", "error", "state"])
def test_one_call_each(name: str) -> None:
    picture = getattr(report if name in ("inefficiency", "state") else of_bodies, f"plot_{name}")(
        synthetic_result(num_frames=8)
    )
    assert len(picture._repr_png_()) > 5000


def test_chosen_frames_and_coordinates() -> None:
    tree = synthetic_result(num_frames=8)
    assert plot_overlay(tree, frame=12).axes[0].get_title(loc="left") == "frame 12"
    chosen = ["knee_r.X", "root.tx"]
    assert [axes.get_title(loc="left") for axes in report.plot_state(tree, chosen).axes] == chosen
    with pytest.raises(ValueError, match="no frame 99; expected 10 to 17"):
        plot_pose3d(tree, frame=99)


def test_bars_of_ranks_are_shares_of_all_simulations() -> None:
    ranks = np.random.default_rng(0).beta(0.5, 1.0, (20, 30, 2))
    unused = dict.fromkeys(("bias", "bias_error", "excess", "excess_error"), np.zeros(2))
    axes = report.plot_ranks(Calibration(ranks, ("x", "y"), **unused, chance=1.0)).axes
    for each, name, values in zip(axes, ("x", "y"), np.moveaxis(ranks, -1, 0), strict=True):
        assert each.get_title(loc="left") == name
        bars = each.patches
        np.testing.assert_allclose([bar.get_height() for bar in bars], np.histogram(values, 10, (0, 1))[0] / 600, rtol=1e-12)
        np.testing.assert_allclose([bar.get_x() for bar in bars], np.arange(10) / 10, atol=1e-12)


def test_a_mean_without_quantiles_has_no_interval() -> None:
    tree = synthetic_result(num_frames=8)
    tree["summary"] = tree["summary"].to_dataset().drop_vars("state_quantile")
    axes = report.plot_state(tree, ["knee_r.X"]).axes[0]
    assert [line.get_label() for line in axes.get_lines()] == ["posterior mean", "truth"] and not axes.collections


def test_overlay_shows_observations_where_they_are() -> None:
    tree = synthetic_result(num_frames=8)
    lines = plot_overlay(tree, frame=11).axes[0].get_lines()
    np.testing.assert_allclose(np.array(lines[-1].get_data()).T, tree["observed_data/points"].values[1, 0])


@pytest.mark.full
def test_expected_error_matches_the_truth_of_a_calibrated_posterior() -> None:
    """The truth is one more draw: its error lies in the 90 % band as often, within 5 binomial standard errors."""
    tree = synthetic_result(num_frames=400, rho=0.0)
    band = expected_error(tree)
    assert band is not None
    error = np.linalg.norm(tree["summary/markers_mean"].values - tree["truth/markers"].values, axis=-1).mean(axis=-1)
    share = ((band[0] <= error) & (error <= band[2])).mean()
    assert abs(share - 0.9) < 5 * np.sqrt(0.09 / 400)
    wrong = synthetic_result(num_frames=400, rho=0.0, truth_scale=2.0)
    error = np.linalg.norm(wrong["summary/markers_mean"].values - wrong["truth/markers"].values, axis=-1).mean(axis=-1)
    assert ((band[0] <= error) & (error <= band[2])).mean() < 0.9 - 5 * np.sqrt(0.09 / 400)


@pytest.mark.full
def test_evenly_and_segments() -> None:
    assert list(evenly(5, 9)) == [0, 1, 2, 3, 4]
    assert list(evenly(101, 3)) == [0, 50, 100]
    path = segments(np.arange(45.0).reshape(15, 3), EDGES)
    assert path.shape == (3 * len(EDGES), 3)
    assert np.isnan(path[2::3]).all()
    np.testing.assert_array_equal(path[1::3, 0], 3.0 * EDGES[:, 1])
