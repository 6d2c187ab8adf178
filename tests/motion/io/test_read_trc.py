from __future__ import annotations

import numpy as np
import pytest
from recording_samples import TRC

from poseppl.errors import InputError
from poseppl.motion.io.recording import read_motion
from poseppl.motion.io.trc import read_trc


def read(tmp_path, text=TRC, **options):
    (tmp_path / "walk.trc").write_text(text)
    return read_trc(tmp_path / "walk.trc", **options)


def test_by_hand(tmp_path):
    motion = read(tmp_path)
    assert (motion.names, motion.parents, motion.rate) == (("C7", "L.ASIS"), (), 50.0)
    expected = [[[100, -300, 200], [400, -600, 500]], [[110, -310, 210], [np.nan] * 3]]
    np.testing.assert_allclose(motion.positions, expected)
    np.testing.assert_allclose(read(tmp_path, up="z").positions[0, 0], [100, 200, 300])


@pytest.mark.parametrize("change", [("\t", ","), ("\tcm\t", "\t\tcm\t"), ("\n", "\t\t\n"), ("Units", "UNITS"), ("\n", "\r\n")])
def test_untidy_files(tmp_path, change):
    np.testing.assert_array_equal(read(tmp_path, TRC.replace(*change)).positions, read(tmp_path).positions)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cm", "furlong", "line 3, Units: unit 'furlong' .expected .mm. or .cm."),
        ("L.ASIS", "C7", "line 4: two markers are called 'C7'"),
        ("Frame#", "Frame", "line 4: no line Frame#"),
        ("50\t50", "0\t50", "line 3, DataRate: 0 frames a second"),
        ("11\t21", "11\tx", "line 8, column 4: 'x' is not a number"),
        ("60\n", "60\t70\n", "line 7: 9 fields .expected 8"),
        ("10\t", "1e12\t", "line 7, column 3: the number 1e12 is too large"),
    ],
)
def test_malformed_files_are_refused(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, TRC.replace(old, new))


@pytest.mark.parametrize(
    ("name", "shape", "top"),
    [
        ("walking1", (131, 51, 3), (1400, 1500)),
        ("static1", (517, 55, 3), (1400, 1500)),
        ("motion_capture_walk", (238, 41, 3), (1500, 1600)),
        ("pyomeca_markers", (93, 51, 3), None),
    ],
)
def test_recordings(data_dir, name, shape, top):
    motion = read_motion(data_dir / "opensim_mocap" / f"{name}.trc")
    assert motion.positions.shape == shape and motion.rate == 100.0
    if top:
        assert top[0] < np.nanmax(motion.positions[..., 2]) < top[1] and 0 < np.nanmin(motion.positions[..., 2]) < 100
