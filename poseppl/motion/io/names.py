"""Names of joints and markers as programs write them, and tables of which points of a recording are which markers of a body.

``mixamorig:LeftArm``, ``Subject 1:LeftArm``, ``Armature|LeftArm`` and, where most names begin alike, ``Actor_LeftArm`` are all
``LeftArm``. A table is TOML:

    pelvis = "hip"
    neck = ["C7", "CLAV"]        # the mean of several points
    knee_l = "lShin"
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_toml

_SHARE = 0.8
"""A prefix that ends in ``_``, ``.`` or a space is one of the program if at least this share of the names begin with it."""
_FEW = 4
"""Fewer names than this have no common prefix."""


def without_prefixes(names: Sequence[str]) -> tuple[str, ...]:
    """Remove namespaces, and a prefix that most names share.

    >>> without_prefixes(["mixamorig:Hips", "Armature|Hips", "Hips"])
    ('Hips', 'Hips', 'Hips')
    >>> without_prefixes(["Bip01", "Bip01_Head", "Bip01_Neck", "Bip01_Spine", "Bip01_L_Foot", "Bip01_R_Foot"])
    ('Bip01', 'Head', 'Neck', 'Spine', 'L_Foot', 'R_Foot')
    """
    bare = [without_namespace(name) for name in names]
    starts = Counter(start[0] for name in bare if (start := re.match(r"[^_. ]+[_. ]+(?=.)", name)))
    prefix, count = starts.most_common(1)[0] if starts else ("", 0)
    if len(bare) >= _FEW and count >= _SHARE * len(bare):
        bare = [name.removeprefix(prefix) for name in bare]
    return tuple(bare)


def without_namespace(name: str) -> str:
    """Part of a name after its last ``:`` or ``|``."""
    return re.split("[:|]", name)[-1].strip() or name


def folded(name: str) -> str:
    """A name in small letters, without punctuation; ``+`` stays.

    >>> folded("L.ASIS + R.ASIS")
    'lasis+rasis'
    """
    return re.sub("[^0-9a-z+]", "", name.lower())


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
