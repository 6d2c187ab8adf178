"""Which axis points up: of a person who stands, of files that say it, and where nothing does."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io.motion import z_up
from poseppl.motion.io.units_and_axes import AXES, check_axis, vertical_axis

NAMES = ("mixamorig:Head", "mixamorig:LeftToeBase", "mixamorig:RightToeBase", "mixamorig:LeftHand", "mixamorig:RightHand")
STANDING = np.array([[0, 0, 1650], [100, 50, 20], [-100, 50, 20], [900, 0, 1400], [-900, 0, 1400]], float)


def recording(up: str, frames: int = 8) -> np.ndarray:
    """A person who walks with arms to the sides, with an axis up."""
    path = np.linspace(0, 3000, frames)[:, None, None] * np.array([0, 1, 0])
    turn = z_up(np.eye(3), up).T  # from our axes to the file's
    return (STANDING + path) @ turn


@pytest.mark.parametrize("up", AXES)
def test_the_head_is_above_the_feet(up: str) -> None:
    places = recording(up)
    found = vertical_axis(NAMES, places, usual="z", kind="C3D files")
    assert found.axis == up and found.certain
    assert found.note().startswith(f"{up.upper()} is up: the head") and "up sets another axis" in found.note()
    np.testing.assert_allclose(z_up(places, found.axis)[:, 0, 2], 1650)
    turned = z_up(np.eye(3), up)
    assert np.linalg.det(turned) == pytest.approx(1)


def test_gaps_and_other_names_do_not_matter() -> None:
    places = recording("y")
    places[::2, 0], places[1, 1:3], places[5:] = np.nan, np.nan, np.nan
    for names in (NAMES, ("LFHD", "LANK", "RHEE", "LFIN", "RFIN"), ("head", "foot_l", "foot_r", "a", "b")):
        assert vertical_axis(names, places, usual="z", kind="C3D files")[::2] == ("y", True)


def test_what_a_file_states_is_taken_and_a_contradiction_is_reported() -> None:
    places = recording("y")
    agreed = vertical_axis(NAMES, places, stated="y", stated_by="POINT:Y_SCREEN", usual="z", kind="C3D files")
    assert agreed == ("y", "POINT:Y_SCREEN says so", True)
    other = vertical_axis(NAMES, places, stated="z", stated_by="POINT:Y_SCREEN", usual="z", kind="C3D files")
    assert other.axis == "z" and not other.certain
    assert "above the feet along Y" in other.note() and "up sets another axis" in other.note()
    given = vertical_axis(NAMES, places, given="x", stated="z", usual="z", kind="C3D files")
    assert given.note() == "X is up: up says so"


def test_an_unknown_axis_is_assumed_and_named() -> None:
    lying, tall = recording("x"), recording("y")
    tall[:, 3:, 0] *= 0.2
    tumbling = np.concatenate([recording(axis, 2) for axis in AXES])
    anonymous = [f"M{number}" for number in range(5)]
    assert vertical_axis(anonymous, tall, usual="z", kind="C3D files")[::2] == ("y", False)  # by far the longest
    assert vertical_axis(anonymous, tall, usual="z", kind="TRC files", agreed=True)[::2] == ("z", False)
    assert vertical_axis(anonymous, lying, usual="z", kind="C3D files")[::2] == ("z", False)
    unsure = vertical_axis(NAMES, tumbling, usual="z", kind="C3D files")
    assert unsure[::2] == ("z", False) and "assumed" in unsure.note() and "up sets another axis" in unsure.note()
    assert vertical_axis(NAMES, tumbling, rest=recording("y", 1)[0], usual="z", kind="BVH files")[::2] == ("y", True)
    assert vertical_axis(NAMES, np.full((3, 5, 3), np.nan), usual="y", kind="TRC files")[::2] == ("y", False)


def test_axes_are_checked() -> None:
    check_axis("-y")
    with pytest.raises(InputError, match="up: 'up' is no axis"):
        check_axis("up")
