"""Tables of names: which points of a recording are which markers of a body, as TOML.

pelvis = "hip"
neck = ["C7", "CLAV"]        # the mean of several points
knee_l = "lShin"
"""

from __future__ import annotations

from os import PathLike

from poseppl.errors import InputError
from poseppl.files.bounded_reading import read_toml

MAX_MARKERS = 1000


def read_names(path: str | PathLike[str]) -> dict[str, tuple[str, ...]]:
    """Read a table of names.

    Args:
        path: The TOML file.

    Returns:
        For each marker the points whose mean it is.

    Raises:
        InputError: The file is no TOML, empty, or a marker has neither a name nor a list of names.
    """
    table = read_toml(path)
    if not 0 < len(table) <= MAX_MARKERS:
        raise InputError(f"{len(table)} names", file=path, expected='lines such as knee_l = "LeftLeg"')
    return {marker: _points(path, marker, value) for marker, value in table.items()}


def _points(path: str | PathLike[str], marker: str, value: object) -> tuple[str, ...]:
    points = value if isinstance(value, list) else [value]
    if not points or not all(isinstance(point, str) and point for point in points):
        expected = 'the name of a point, or a list of names: "LeftLeg", ["LKNE", "LKNM"]'
        raise InputError("not a name", file=path, field=marker[:40], expected=expected)
    return tuple(points)
