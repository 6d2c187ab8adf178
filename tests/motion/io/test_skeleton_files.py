"""Skeletons of named points as TOML."""

from __future__ import annotations

from pathlib import Path

import pytest

from poseppl.errors import InputError
from poseppl.motion.io.skeleton_files import GIVE, RIGID_GIVE, Link, read_skeleton

GOOD = """
units = "cm"
points = ["hip", "knee", "ankle", "knee_r"]

[[links]]
between = ["knee", "hip"]
length = 4
give = 0.01

[[links]]
between = ["hip", "knee_r"]

[[rigid]]
points = ["knee", "ankle", "knee_r"]

[[pairs]]
left = ["knee"]
right = ["knee_r"]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "skeleton.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_skeleton_is_read(tmp_path: Path) -> None:
    skeleton = read_skeleton(write(tmp_path, GOOD))
    assert skeleton.points == ("hip", "knee", "ankle", "knee_r")
    assert skeleton.links[0] == Link((0, 1), 40.0, 4.0, 0.01)
    assert skeleton.links[1] == Link((0, 3), None, None, GIVE)
    assert [link.ends for link in skeleton.links[2:]] == [(1, 2), (1, 3), (2, 3)]
    assert {link.give for link in skeleton.links[2:]} == {RIGID_GIVE}
    assert skeleton.pairs == (((1,), (3,)),)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('units = "cm"\n', "", "in no unit"),
        ('units = "cm"', 'units = "inch"', "units"),
        ('"ankle", "knee_r"]\n\n', '"ankle", "ankle"]\n\n', "two points are called"),
        ('["knee", "hip"]', '["knee", "toe"]', "'toe'"),
        ('["knee", "hip"]', '["knee", "knee"]', "comes twice"),
        ('["knee", "hip"]', '["knee"]', "between 1 points"),
        ("length = 4", "length = -4", "length is -4"),
        ("length = 4", "spread = 4", "without a length"),
        ("length = 4", "lenght = 4", "'lenght' is unknown"),
        ("give = 0.01", "give = true", "give is True"),
        ('["knee", "hip"]', '["knee", "ankle"]', "linked twice"),
        ('right = ["knee_r"]', 'right = ["knee_r", "hip"]', "on the right"),
        ('right = ["knee_r"]', 'right = ["knee"]', "on the right"),
        ("[[pairs]]", "[pairs]", "list of tables"),
        ("points = [", "points_ = [", "'points_' is unknown"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert old in GOOD
    with pytest.raises(InputError, match="skeleton.toml") as error:
        read_skeleton(write(tmp_path, GOOD.replace(old, new, 1)))
    assert told in str(error.value)
