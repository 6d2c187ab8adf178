"""Files for other programs: our own readers and ezc3d read what we write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io.c3d import load_ezc3d, read_c3d, write_c3d
from poseppl.motion.io.motion import Motion, y_up, z_up
from poseppl.motion.io.opensim_files import read_mot, write_mot
from poseppl.motion.io.trc import read_trc, write_trc

FRAMES = np.arange(3, 12, 3)
TIMES = FRAMES / 60.0


def motion(*, gap: bool = False) -> Motion:
    positions = np.random.default_rng(0).normal(0.0, 800.0, (3, 2, 3))
    if gap:
        positions[1, 0] = np.nan
    return Motion(("knee_r", "crown"), positions, (), 20.0, "made")


def test_up_and_back() -> None:
    positions = motion().positions
    np.testing.assert_array_equal(z_up(y_up(positions), "y"), positions)
    np.testing.assert_array_equal(y_up(np.eye(3)), [[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def test_trc_round_trip(tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", motion(), TIMES, FRAMES)
    read = read_trc(tmp_path / "a.trc")
    assert (read.names, read.rate) == (("knee_r", "crown"), 20.0)
    np.testing.assert_allclose(read.positions, motion().positions, atol=0.5e-4)  # four digits are written
    header = (tmp_path / "a.trc").read_text().splitlines()
    assert dict(zip(header[1].split("\t"), header[2].split("\t"), strict=True))["Units"] == "mm"
    assert [line.split("\t")[:2] for line in header[6:]] == [["3", "0.05"], ["6", "0.1"], ["9", "0.15"]]


@pytest.mark.parametrize("name", ["walking1", "motion_capture_walk"])
def test_a_recording_written_again(data_dir: Path, tmp_path: Path, name: str) -> None:
    known = read_trc(data_dir / "opensim_mocap" / f"{name}.trc")
    whole = np.isfinite(known.positions).all((0, 2))
    names = [each for each, seen in zip(known.names, whole, strict=True) if seen and " " not in each]
    places = known.positions[:, [known.index(each) for each in names]]
    kept = Motion(tuple(names), places, (), known.rate, known.source)
    write_trc(tmp_path / "a.trc", kept, np.arange(len(places)) / known.rate, np.arange(len(places)))
    read = read_trc(tmp_path / "a.trc")
    assert (read.names, read.rate) == (kept.names, known.rate)
    np.testing.assert_allclose(read.positions, places, atol=0.5e-4)


def test_the_header_has_the_fields_of_other_programs(data_dir: Path, tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", motion(), TIMES, FRAMES)
    ours = (tmp_path / "a.trc").read_text().splitlines()
    theirs = (data_dir / "pose2sim_balancing" / "reference" / "Balancing_for_IK.trc").read_text().splitlines()
    assert ours[0].split("\t")[:3] == theirs[0].split("\t")[:3]
    assert ours[1] == theirs[1]
    assert ours[3].split("\t")[:2] == theirs[3].split("\t")[:2]
    assert ours[4].split("\t")[:8] == theirs[4].split("\t")[:8]


def test_no_nan_reaches_opensim(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="frame 6: 'knee_r' has no finite place"):
        write_trc(tmp_path / "a.trc", motion(gap=True), TIMES, FRAMES)
    with pytest.raises(InputError, match="knee_angle_r is not finite at 0.1 s"):
        write_mot(tmp_path / "a.mot", TIMES, {"knee_angle_r": np.array([0.0, np.inf, 0.0])})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", "left knee", "knee\t", "a\nb"])
def test_names_that_break_columns_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="a column cannot be named"):
        write_trc(tmp_path / "a.trc", Motion((name, "b"), np.zeros((1, 2, 3)), (), 20.0, "made"), TIMES[:1], FRAMES[:1])
    with pytest.raises(InputError, match="a column cannot be named"):
        write_mot(tmp_path / "a.mot", TIMES[:1], {name: np.zeros(1)})


def test_mot_round_trip(tmp_path: Path) -> None:
    columns = {"knee_angle_r": np.array([1.5, -170.0, 0.25]), "pelvis_ty": np.array([0.9, 0.91, 0.92])}
    write_mot(tmp_path / "a.mot", TIMES, columns, ["knee_angle_r: flexion = positive\nof the knee"])
    read = read_mot(tmp_path / "a.mot")
    assert read.in_degrees and list(read.columns) == list(columns)
    np.testing.assert_allclose(read.times, TIMES)
    for name, values in columns.items():
        np.testing.assert_allclose(read.columns[name], values, atol=1e-8)
    assert "knee_angle_r: flexion is positive of the knee" in (tmp_path / "a.mot").read_text().splitlines()


def test_motion_files_of_other_programs(data_dir: Path) -> None:
    walk = read_mot(data_dir / "opensim_mocap" / "walking1_ik.mot")
    assert (len(walk.times), len(walk.columns), walk.in_degrees) == (131, 33, False)
    assert walk.columns["knee_angle_r"][0] == 0.13005
    reference = data_dir / "pose2sim_balancing" / "reference"
    balance = read_mot(next(reference.glob("*.mot")))
    assert balance.in_degrees and balance.columns["pelvis_list"][0] == 4.33024803
    commas = read_mot(data_dir / "opensim_mocap" / "pyomeca_inverse_kin.mot")
    assert commas.in_degrees and (commas.times[0], commas.columns["elbow_flexion"][0]) == (1.56, 42.06628447)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Coordinates\n", "no line endheader"),
        ("endheader\ntime a\n", "no frame"),
        ("endheader\na time\n0 1\n", "2 columns"),
        ("endheader\ntime a a\n0 1 2\n", "two columns are called 'a'"),
        ("endheader\ntime a\n0 1 2\n", "line 3: 3 values"),
        ("endheader\ntime a\n0 nan\n", "line 3, a: 'nan'"),
    ],
)
def test_malformed_motion_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.mot").write_text(text)
    with pytest.raises(InputError, match=message):
        read_mot(tmp_path / "a.mot")


def test_c3d_holds_the_spread_and_the_gaps(tmp_path: Path) -> None:
    known, spread = motion(gap=True), np.array([[1.0, 40.0], [9.0, 0.3], [12.6, 80.0]])
    write_c3d(tmp_path / "a.c3d", known, spread, FRAMES)
    file = load_ezc3d().c3d(str(tmp_path / "a.c3d"))
    residuals = file["data"]["meta_points"]["residuals"][0].T
    expected = np.where(np.isnan(known.positions[..., 0]), -1.0, spread)
    np.testing.assert_allclose(residuals, expected, atol=0.5 * 80.0 / 250 + 1e-6)  # a byte in units of a 250th
    assert np.isnan(file["data"]["points"][:3, 0, 1]).all()
    assert file["header"]["points"]["first_frame"] == 3
    read = read_c3d(tmp_path / "a.c3d")
    assert (read.names, read.rate) == (known.names, 20.0)
    np.testing.assert_allclose(read.positions, known.positions, rtol=1e-6)


def test_c3d_of_too_many_points_is_refused(tmp_path: Path) -> None:
    many = Motion(tuple(map(str, range(256))), np.zeros((1, 256, 3)), (), 20.0, "made")
    with pytest.raises(InputError, match="256 points in 1 frames"):
        write_c3d(tmp_path / "a.c3d", many, np.zeros((1, 256)), FRAMES[:1])
