"""Tables of names: which points of a recording are which markers of a body, as TOML.

pelvis = "hip"
neck = ["C7", "CLAV"]        # the mean of several points
knee_l = "lShin"
"""

from __future__ import annotations

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_toml

MAX_MARKERS = 1000


def read_names(path: FilePath) -> dict[str, tuple[str, ...]]:
    """Read a table of names.

    Args:
        path: The TOML file.

    Returns:
        For each marker the points whose mean it is.

    Raises:
        InputError: The file is no TOML, empty, or a marker has neither a name nor a list of names.
    """
    table, at = read_toml(path), Location(path)
    if not 0 < len(table) <= MAX_MARKERS:
        raise at.error(f"{len(table)} names", 'lines such as knee_l = "LeftLeg"')
    return {marker: _points(at, marker, value) for marker, value in table.items()}


def _points(at: Location, marker: str, value: object) -> tuple[str, ...]:
    points = value if isinstance(value, list) else [value]
    if not points or not all(isinstance(point, str) and point for point in points):
        expected = 'the name of a point, or a list of names: "LeftLeg", ["LKNE", "LKNM"]'
        raise at.in_field(marker).error("not a name", expected)
    return tuple(points)
