"""DeepLabCut's and Lightning Pose's tables: real ones, and ones that are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io.deeplabcut import read_deeplabcut_csv

ONE = """scorer,net,net,net,net,net,net
bodyparts,knee,knee,knee,foot,foot,foot
coords,x,y,likelihood,x,y,likelihood
0,1.5,2.5,0.9,3.5,4.5,0.8
2,,,1.0,nan,NaN,1.0
3,0.0,0.0,0.0,5,6,0.25
"""
SEVERAL = """scorer,net,net,net,net,net,net,net,net,net
individuals,mouse1,mouse1,mouse1,mouse2,mouse2,mouse2,single,single,single
bodyparts,nose,nose,nose,nose,nose,nose,corner,corner,corner
coords,x,y,likelihood,x,y,likelihood,x,y,likelihood
0,1,2,0.5,3,4,0.75,5,6,1
1,1,2,0.5,,,,5,6,1
"""
LABELS = """scorer,,,me,me
bodyparts,,,nose,nose
coords,,,x,y
labeled-data,day1,img0012.png,1.5,2.5
labeled-data,day1,img0014.png,,
"""


def read(tmp_path: Path, text: str):  # type: ignore[no-untyped-def]
    (tmp_path / "points.csv").write_text(text)
    return read_deeplabcut_csv(tmp_path / "points.csv")


def test_a_recording_is_read(data_dir: Path) -> None:
    (file,) = (data_dir / "fly_legs").glob("*Cam-B*rng=1.csv")
    found = read_deeplabcut_csv(file)
    plain = np.genfromtxt(file, delimiter=",", skip_header=3)[:, 1:].reshape(500, 1, 12, 3)
    assert found.names[:3] == ("L1A", "L1B", "L2A") and len(found.names) == 12
    np.testing.assert_array_equal(found.points, plain[..., :2])
    np.testing.assert_array_equal(found.confidence, plain[..., 2])
    assert found.frames.tolist() == list(range(500)) and found.layout == "" and found.individuals == ()


def test_what_is_no_number_is_missing_whatever_its_likelihood(tmp_path: Path) -> None:
    found = read(tmp_path, ONE)
    assert found.frames.tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(found.confidence[:, 0], [[0.9, 0.8], [0, 0], [0, 0], [0, 0.25]])
    assert np.isnan(found.points[1:3]).all() and np.isnan(found.points[3, 0, 0]).all()
    np.testing.assert_array_equal(found.points[3, 0, 1], [5, 6])


def test_several_animals(tmp_path: Path) -> None:
    found = read(tmp_path, SEVERAL)
    assert found.individuals == ("mouse1", "mouse2", "single") and found.names == ("nose", "corner")
    np.testing.assert_array_equal(found.points[0, :2, 0], [[1, 2], [3, 4]])
    np.testing.assert_array_equal(np.isfinite(found.points[1]).all(-1), [[True, False], [False, False], [False, True]])


def test_labels_by_hand_are_certain(tmp_path: Path) -> None:
    found = read(tmp_path, LABELS)
    assert found.frames.tolist() == [12, 13, 14]
    np.testing.assert_array_equal(found.confidence[:, 0, 0], [1, 0, 0])


def test_other_columns_are_passed_over(tmp_path: Path) -> None:
    text = ONE.replace("net,net,net,net\n", "net,net,net,net,net\n").replace("foot\n", "foot,foot\n")
    text = text.replace("likelihood\n", "likelihood,x_ens_var\n")
    text = "\n".join(line + ",7" if line[:1].isdigit() else line for line in text.splitlines())
    np.testing.assert_array_equal(read(tmp_path, text).points, read(tmp_path, ONE).points)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (ONE, "frame,marker\n", "line 1: 'frame' where a header row begins"),
        ("bodyparts,knee", "names,knee", "line 2: 'names' where a header row begins"),
        ("bodyparts,knee,knee,knee,foot,foot,foot\n", "", "line 2: no header row bodyparts"),
        ("coords,x,y,likelihood,x", "coords,x,y,likelihood,y", "line 3: 'foot' lacks a coordinate"),
        ("foot,foot,foot", "knee,knee,knee", "line 3: a coordinate comes twice among knee"),
        ("foot,foot,foot", "foot,foot", "line 2: 6 values"),
        ("5,6,0.25", "5,6", "line 6: 6 values .expected 7, one a column; the file may have been cut off"),
        ("5,6,0.25", "5,six,0.25", "line 6: 'six' is not a number"),
        ("5,6,0.25", "5,1e10,0.25", "line 6: the number 1e10 is too large"),
        ("\n2,", "\n0,", "line 5: frame 0 comes twice"),
        ("\n2,", "\nx,", "line 5: 'x' has no frame number"),
        ("\n3,", "\n3000000,", "frames 0 to 3000000 .expected at most 1000000 frames"),
    ],
)
def test_what_is_wrong_is_reported(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in ONE
    with pytest.raises(InputError, match=rf"points\.csv.*{words}"):
        read(tmp_path, ONE.replace(old, new, 1))


def test_a_table_without_points(tmp_path: Path) -> None:
    header = "".join(ONE.splitlines(keepends=True)[:3])
    with pytest.raises(InputError, match="the file has no frame"):
        read(tmp_path, header)
    with pytest.raises(InputError, match="nothing was found in any of 1 frames"):
        read(tmp_path, header + "0,,,,,,\n")
