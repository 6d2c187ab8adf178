from __future__ import annotations

import numpy as np
import pytest
from recording_samples import CSV

from poseppl.errors import InputError
from poseppl.motion.io.observations import Observations, read_observations, write_observations

MARKERS, CAMERAS = ("hip", "knee", "ankle"), ("left", "right")


def read(tmp_path, text=CSV, markers=MARKERS, cameras=CAMERAS):
    (tmp_path / "points.csv").write_text(text)
    return read_observations(tmp_path / "points.csv", markers, cameras)


def test_rows_find_their_place(tmp_path):
    observations = read(tmp_path)
    assert observations.points.shape == (3, 2, 3, 2)
    np.testing.assert_array_equal(observations.frames, [3, 4, 5])
    np.testing.assert_array_equal(observations.points[0, 0, :2], [[10.5, 20.0], [11.0, 30.25]])
    np.testing.assert_array_equal(observations.points[2, 1, 1], [13.0, 31.0])
    assert np.isfinite(observations.points).all(axis=-1).sum() == 4
    assert observations.confidence[2, 1, 1] == 0.75 and np.isnan(observations.confidence[1]).all()


def test_one_camera_needs_no_column(tmp_path):
    observations = read(tmp_path, "X, Y ,marker,frame\n1,2,hip,0\n\n3,4,ankle,1\n", cameras=("camera",))
    np.testing.assert_array_equal(observations.points[1, 0, 2], [3.0, 4.0])
    assert observations.confidence is None


@pytest.mark.parametrize("cameras", [("camera",), ("left", "right", 'with "quotes", and commas')])
@pytest.mark.parametrize("graded", [True, False])
def test_round_trip(tmp_path, cameras, graded):
    rng = np.random.default_rng(0)
    points = rng.normal(0.0, 1e3, (7, len(cameras), 3, 2))
    seen = rng.random(points.shape[:3]) < 0.7
    seen[[0, -1]] = True
    points[~seen] = np.nan
    confidence = np.where(seen, rng.random(seen.shape), np.nan) if graded else None
    written = Observations(points, confidence, np.arange(10, 17), MARKERS, cameras)
    write_observations(tmp_path / "out.csv", written)
    again = read_observations(tmp_path / "out.csv", MARKERS, cameras)
    np.testing.assert_array_equal(again.points, points)
    np.testing.assert_array_equal(again.frames, written.frames)
    if graded:
        np.testing.assert_array_equal(again.confidence, confidence)
    else:
        assert again.confidence is None
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (CSV, "", "the file is empty"),
        (CSV, "\n\n", "no column 'frame'"),
        (CSV, "frame,marker,x,y,camera\n", "the file has no observation"),
        ("frame,marker,x", "frame,marker,z", "line 1: no column 'x'"),
        ("confidence", "weight", "line 1, weight: column is unknown"),
        ("confidence", "x", "line 1, x: column is repeated"),
        ("3,knee", "3,kneee", "line 3: unknown marker 'kneee' (expected one of hip, knee, ankle; did you mean 'knee'?)"),
        ("31,right", "31,rihgt", "line 5: unknown camera 'rihgt'"),
        ("30.25", "thirty", "line 3, y: 'thirty' is not a number"),
        ("30.25", "", "line 3, y: '' is not a number"),
        ("30.25", "inf", "line 3, y: 'inf'"),
        ("30.25", "NaN", "line 3, y: 'NaN'"),
        ("right,0.75", "right,1.75", "line 5, confidence"),
        ("right,0.75", "right", "line 5: 5 values (expected 6"),
        ("5,knee", "-5,knee", "line 5, frame: '-5' is no frame number"),
        ("5,knee", "5.0,knee", "line 5, frame"),
        ("5,knee", "999999999,knee", "line 5, frame: 999999995 frames without any row"),
        ("5,knee,13,31,right", "3,knee,13,31,left", "observes 'knee' twice (before in line 3)"),
        ("30.25,left", '30.25,"left', "malformed CSV"),
    ],
)
def test_bad_csv(tmp_path, old, new, message):
    assert old in CSV
    with pytest.raises(InputError) as caught:
        read(tmp_path, CSV.replace(old, new, 1))
    assert message in str(caught.value) and "points.csv" in str(caught.value)


def test_too_many_frames_are_refused(tmp_path):
    rows = "".join(f"{frame},hip,0,0\n" for frame in range(0, 50_000, 10_000))
    with pytest.raises(InputError, match="at most 20000000 points"):
        read(tmp_path, "frame,marker,x,y\n" + rows, markers=["hip", *map(str, range(1000))], cameras=("camera",))


def test_several_cameras_need_the_column(tmp_path):
    with pytest.raises(InputError, match="no column camera"):
        read(tmp_path, "frame,marker,x,y\n0,hip,1,2\n")
