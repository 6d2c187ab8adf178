"""Surroundings of the body: rays, cameras and floor against plain geometry."""

from __future__ import annotations

import numpy as np
import pytest
from rooms import CENTRES, FOCAL, PRINCIPAL, ROTATIONS, projected, room_result
from synthetic import synthetic_result

from poseppl.motion.report.pose_views import MAX_SAMPLES, pose_data, room_data
from poseppl.report import report_html
from poseppl.report.page import to_json

TREE = room_result()


def test_rays_end_where_the_camera_saw_the_marker_as_far_away_as_the_mean() -> None:
    chosen = np.array([2, 4, 9])
    rays, seen = room_data(TREE, chosen)["rays"], TREE["observed_data/points"].values[chosen]
    mean = TREE["summary/markers_mean"].values[chosen]
    for number in range(len(chosen)):
        again = np.stack([projected(rays[number, camera])[camera] for camera in range(2)])
        # the mean of the projections, from which residuals are counted, is not the projection of the mean: by 0.15 px here
        np.testing.assert_allclose(again, seen[number], atol=0.5, equal_nan=True)
        for camera in range(2):
            depth = [(points - CENTRES[camera]) @ ROTATIONS[camera][2] for points in (rays[number, camera], mean[number])]
            known = np.isfinite(depth[0])
            np.testing.assert_allclose(depth[0][known], depth[1][known], rtol=1e-6)
    assert np.isnan(rays[1, 1, 2]).all() and np.isfinite(rays[1, 0]).all()


def test_pictures_of_cameras_stand_before_them_and_hold_what_they_saw() -> None:
    cameras = room_data(TREE, np.arange(12))["cameras"]
    for camera, corners in enumerate(cameras["corners"]):
        corner = projected(corners)[camera] - PRINCIPAL[camera]
        middle = np.abs(TREE["observed_data/points"].values[:, camera] - PRINCIPAL[camera])
        assert (np.sign(corner) == [[-1, -1], [1, -1], [1, 1], [-1, 1]]).all(), "in front of the camera, one after the other"
        assert np.nanmean(middle <= np.abs(corner[0]) + 1) > 0.97
    assert cameras["names"] == ["left", "a camera with a long name"]
    assert FOCAL.shape == (2, 2) and room_data(synthetic_result(num_frames=3), np.arange(3))["cameras"] is None


@pytest.mark.parametrize(("raised", "expected"), [(0.0, 0.0), (900.0, 970.0), (-500.0, -430.0)])
def test_the_floor_is_at_zero_where_that_is_near_the_lowest_marker(raised: float, expected: float) -> None:
    tree = room_result()
    tree["summary/markers_mean"].values[..., 2] += raised
    assert room_data(tree, np.arange(3))["floor"] == pytest.approx(expected, abs=25)
    del tree["body"].attrs["root"]
    assert room_data(tree, np.arange(3))["floor"] is None


@pytest.mark.slow
def test_a_report_of_many_frames_cameras_and_markers_stays_small() -> None:
    """Two thousand frames, four cameras: without Plotly's library less than 3 MB."""
    from plotly.offline import get_plotlyjs

    tree = room_result(2000, flesh=True)
    for group in ("posterior", "observed_data", "camera"):  # each camera twice
        wide = tree[group].to_dataset()
        doubled = wide.isel(camera=[0, 1, 0, 1]).assign_coords(camera=["a", "b", "c", "d"])
        tree = tree.assign({group: type(tree)(doubled)})
    assert len(report_html(tree).encode()) - len(get_plotlyjs().encode()) < 3_000_000


def test_fewer_draws_are_shown_where_there_is_much_to_show(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poseppl.motion.report.pose_views.MAX_VALUES", 110_000)
    tree = room_result(200)
    poses = pose_data(tree)
    assert poses is not None
    frames, samples = poses["image"]["draws"].shape[:2]
    assert frames == 120 and 4 <= samples < MAX_SAMPLES and poses["image"]["draws"].size <= 110_000
    assert poses["space"]["draws"].shape[1] == MAX_SAMPLES
    assert poses["image"]["draws"].shape[2:] == (2, 15, 2)


@pytest.mark.full
def test_a_draw_that_is_far_away_leaves_the_others_as_fine() -> None:
    tree = room_result(6)
    tree["posterior/markers"].values[0, 0, 3, :3] = 1e9
    poses = pose_data(tree, np.arange(6))
    assert poses is not None
    draws = poses["space"]["draws"]
    assert np.ptp(draws) / 65_534 < 2.0, "mm"
    assert len(to_json(poses)) > 1000
