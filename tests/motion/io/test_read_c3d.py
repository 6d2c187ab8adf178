from __future__ import annotations

import struct

import numpy as np
import pytest
from damage import damaged_copies
from recording_samples import c3d_bytes

from poseppl.errors import InputError
from poseppl.motion.io.c3d import load_ezc3d, read_c3d
from poseppl.motion.io.c3d_layout import DEC, read_layout, real_numbers

POINTS = np.random.default_rng(0).normal(0.0, 300.0, (6, 4, 3)).astype(np.float32).astype(np.float64)
LABELS = ["LASI", "RASI", "*1", "LHipAngles"]


def read(tmp_path, data, **options):
    (tmp_path / "small.c3d").write_bytes(data)
    return read_c3d(tmp_path / "small.c3d", **options)


def test_markers_come_back(tmp_path):
    points = POINTS.copy()
    points[2, 1] = np.nan
    motion = read(tmp_path, c3d_bytes(points, LABELS, angles=("LHipAngles",)))
    assert motion.names == ("LASI", "RASI") and motion.parents == ()
    assert motion.rate == 100.0
    np.testing.assert_array_equal(motion.positions, points[:, :2])


def test_units_and_axes(tmp_path):
    motion = read(tmp_path, c3d_bytes(POINTS / 1000.0, list("ABCD"), units="m", vertical="+Y"))
    np.testing.assert_allclose(motion.positions, POINTS[..., [0, 2, 1]] * (1, -1, 1), rtol=1e-6)
    explicit = read(tmp_path, c3d_bytes(POINTS, list("ABCD"), vertical="-Z"), up="z")
    np.testing.assert_array_equal(explicit.positions, POINTS)


def test_the_head_is_above_the_feet_where_no_screen_says_which_axis_is_up(tmp_path):
    points = np.zeros((3, 4, 3), np.float32) + np.array([[0, 1700, 0], [0, 50, 0], [90, 60, 0], [400, 900, 0]])
    labels = ["S:LFHD", "S:LTOE", "S:RANK", "S:LFIN"]
    motion = read(tmp_path, c3d_bytes(points, labels, vertical=""))
    np.testing.assert_allclose(motion.positions[0, 0], [0, 0, 1700])
    assert motion.notes == ("Y is up: the head is above the feet along it. up sets another axis",)
    stated = read(tmp_path, c3d_bytes(points, labels, vertical="+Z"))
    np.testing.assert_allclose(stated.positions, points)
    assert "assumed" in stated.notes[0] and "above the feet along Y" in stated.notes[0]
    with pytest.raises(InputError, match="POINT:Y_SCREEN.*'up'.*up='z'"):
        read(tmp_path, c3d_bytes(points, labels, vertical="up"))


def test_plug_in_gait(data_dir):
    motion = read_c3d(data_dir / "btk_c3d" / "PiG_Motion-FlatFoot-Full.c3d")
    assert motion.positions.shape == (315, 35, 3) and motion.rate == 100.0
    assert {"C7", "LASI", "RTOE", "LFHD"} <= set(motion.names)
    assert not {"LFEO", "PELP", "CentreOfMass", "LHipAngles", "LAnklePower"} & set(motion.names)
    head, toe = motion.positions[:, motion.index("RFHD"), 2], motion.positions[:, motion.index("RTOE"), 2]
    assert 1300 < np.nanmedian(head) < 1700 and 0 < np.nanmin(toe) < 100
    legs = read_c3d(data_dir / "btk_c3d" / "PiG_Motion3_FF.c3d")
    assert legs.positions.shape == (293, 16, 3)


def test_malformed_dance_is_refused(data_dir):
    with pytest.raises(InputError, match=r"Dance\.c3d, LABELS: the parameter ends outside its section"):
        read_c3d(data_dir / "btk_c3d" / "Dance.c3d")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:900], "no C3D header"),
        (lambda data: data[:1300], "parameter blocks"),
        (lambda data: data[:1600], "do not fit into the file"),
        (lambda data: data.replace(b"DATA_START\x07\x00\x02\x00\x04", b"DATA_START\x07\x00\x02\x00\x00"), "POINT:DATA_START"),
        (lambda data: b"\x02\x51" + data[2:], "no C3D header"),
        (lambda data: b"\x00" + data[1:], "parameters in block 0"),
        (lambda data: data[:2] + b"\x05" + data[3:], "the header has 5 points"),
        (lambda data: data[:515] + b"\x57" + data[516:], "byte order 87"),
        (lambda data: data.replace(b"POINT", b"PAINT"), "POINT:USED: the parameter is missing"),
        (lambda data: data.replace(b"mm", b"ft"), "unit 'ft'"),
    ],
)
def test_bad_c3d(tmp_path, change, message):
    data = c3d_bytes(POINTS, LABELS)
    changed = change(data)
    assert changed != data
    with pytest.raises(InputError) as caught:
        read(tmp_path, changed)
    assert message in str(caught.value) and "small.c3d" in str(caught.value)


def test_labels_that_are_no_texts(tmp_path):
    # POINT:LABELS as bytes instead of text.
    data = c3d_bytes(POINTS, LABELS)
    at = data.index(b"LABELS") + 8
    with pytest.raises(InputError, match="POINT: 0 labels"):
        read(tmp_path, data[:at] + b"\x01" + data[at + 1 :])


def test_markers_of_one_name(tmp_path):
    with pytest.raises(InputError, match="two markers are called 'A'"):
        read(tmp_path, c3d_bytes(POINTS, list("AABC")))


@pytest.mark.parametrize("scale", [-1.0, -0.1, 0.25, 0.3])
def test_ezc3d_reads_the_same(tmp_path, data_dir, scale):
    points = POINTS.copy()
    points[2, 1] = np.nan
    (tmp_path / "small.c3d").write_bytes(c3d_bytes(points, list("ABCD"), scale=scale))
    for path in (tmp_path / "small.c3d", data_dir / "btk_c3d" / "PiG_Motion-FlatFoot-Full.c3d"):
        motion, file = read_c3d(path), load_ezc3d().c3d(str(path))
        labels = file["parameters"]["POINT"]["LABELS"]["value"]
        expected = file["data"]["points"][:3, [labels.index(name) for name in motion.names]]
        np.testing.assert_array_equal(motion.positions, np.moveaxis(expected, (0, 1), (2, 1)))


@pytest.mark.parametrize(("unit", "per_mm"), [("mm", 1.0), ("cm", 0.1), ("dm", 0.01), ("m", 0.001), ("in", 1 / 25.4)])
def test_lengths_come_out_in_mm(tmp_path, unit, per_mm):
    motion = read(tmp_path, c3d_bytes(POINTS * per_mm, list("ABCD"), units=unit))
    np.testing.assert_allclose(motion.positions, POINTS, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("order", ["dec", "mips"])
@pytest.mark.parametrize("scale", [-1.0, 0.25])
def test_other_byte_orders_read_alike(tmp_path, order, scale):
    """Numbers as VAX and big-endian machines wrote them, floating-point and whole."""
    points = np.random.default_rng(0).normal(0, 300, (5, 3, 3))
    points[2, 1] = np.nan
    labels = ["LASI", "RASI", "SACR"]
    for name in ("intel", order):
        (tmp_path / f"{name}.c3d").write_bytes(c3d_bytes(points, labels, order=name, scale=scale, rate=59.94))
    expected, found = (read_c3d(tmp_path / f"{name}.c3d") for name in ("intel", order))
    np.testing.assert_array_equal(found.positions, expected.positions)
    np.testing.assert_allclose(found.positions, points, atol=1e-3 if scale < 0 else 0.13)
    assert found.names == expected.names and found.rate == expected.rate == pytest.approx(59.94)


def test_numbers_of_a_vax():
    # from the VAX Architecture reference: 1.0 is 0x00004080, -6.25 is 0x0000C1C8 as little-endian words
    numbers = struct.pack("<3I", 0x00004080, 0x0000C1C8, 0)
    assert real_numbers(numbers, DEC).tolist() == [1.0, -6.25, 0.0]


def test_damaged_files_of_other_orders_are_refused(tmp_path):
    refused = 0
    for order in ("dec", "mips"):
        data = c3d_bytes(np.zeros((3, 2, 3)), ["A", "B"], order=order)
        for damaged in damaged_copies(data, 150):
            (tmp_path / "damaged.c3d").write_bytes(damaged)
            try:
                read_layout(tmp_path / "damaged.c3d")
            except InputError as error:
                refused += 1
                assert len(str(error).splitlines()) == 1
    assert refused > 150
