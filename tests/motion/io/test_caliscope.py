"""Caliscope's tables of points: a real one, and ones that are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.geometry.cameras import nearest_points, viewing_rays
from poseppl.motion.io import read_cameras
from poseppl.motion.io.detector_tables import read_caliscope_points
from poseppl.motion.tracking.placing import cameras_of_records

HEAD = "sync_index,cam_id,object_id,keypoint_id,img_loc_x,img_loc_y\n"


def test_a_board_is_where_it_was_published(data_dir: Path) -> None:
    """Corners by our rays against the file's own triangulation, within 1 mm in the median: 54 mm apart."""
    folder = data_dir / "charuco_board"
    found, records = read_caliscope_points(folder / "xy_CHARUCO.csv"), read_cameras(folder / "camera_array.toml")
    assert list(found) == [record.name for record in records]
    first, last = (pick(people.frames[end] for people in found.values()) for pick, end in ((max, 0), (min, -1)))
    points = np.stack([p.points[first - p.frames[0] : last + 1 - p.frames[0], 0] for p in found.values()], 1)
    cameras = cameras_of_records(records)
    rays = np.stack([viewing_rays(cameras, c, points[:, c]) for c in range(4)], 1)
    places = nearest_points(np.asarray(cameras.centre, np.float64), rays, np.isfinite(points).all(-1).astype(float))
    rows = np.genfromtxt(folder / "xyz_CHARUCO.csv", delimiter=",", names=True)
    off = []
    for row in rows[(rows["sync_index"] >= first) & (rows["sync_index"] <= last)]:
        published = 1000 * np.array([row["x_coord"], row["y_coord"], row["z_coord"]])
        off.append(np.linalg.norm(places[int(row["sync_index"]) - first, int(row["keypoint_id"])] - published))
    assert len(off) > 100 and np.nanmedian(off) < 1.0


def test_times_people_and_gaps(tmp_path: Path) -> None:
    text = "sync_index,port,frame_index,frame_time,point_id,img_loc_x,img_loc_y\n3,1,0,12.5,2,10,20\n5,1,1,12.75,0,30,40\n"
    (tmp_path / "old.csv").write_text(text)
    (found,) = read_caliscope_points(tmp_path / "old.csv").values()
    assert found.times is not None and found.frames.tolist() == [3, 4, 5]
    np.testing.assert_array_equal(found.times, [12.5, np.nan, 12.75])
    np.testing.assert_array_equal(found.confidence[:, 0], [[0, 0, 1], [0, 0, 0], [1, 0, 0]])
    (tmp_path / "new.csv").write_text(HEAD + "0,0,1,0,10,20\n0,1,0,0,10,20\n")
    assert read_caliscope_points(tmp_path / "new.csv")["0"].points.shape == (1, 2, 1, 2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD, "the file has no point"),
        (HEAD.replace("img_loc_x", "x"), "line 1, img_loc_x: the column is missing"),
        (HEAD + "0,0,0,0,1,2\n0,0,0,0,1,2\n", "line 3: frame 0 has keypoint 0 of camera 0 twice"),
        (HEAD + "0,0,0,0,1\n", "line 2: 5 values"),
        (HEAD + "0,0,0,0,1,nan\n", "line 2, img_loc_y: 'nan' is not a number"),
        (HEAD + "0,0,0,5000,1,2\n", "line 2: object 0, keypoint 5000"),
        (HEAD + "0,left,0,0,1,2\n", "line 2, cam_id: 'left' is no number of a camera"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "xy.csv").write_text(text)
    with pytest.raises(InputError, match=rf"xy\.csv.*{words}"):
        read_caliscope_points(tmp_path / "xy.csv")
