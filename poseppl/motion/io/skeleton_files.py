"""Skeletons of named points, for whatever a detector finds points of, as TOML.

units = "mm"                                  of the lengths; needed where there are any

points = ["hip", "knee", "ankle", "knee_r"]   of the detector's; the others are left out

[[links]]
between = ["hip", "knee"]
length = 0.9                                  optional: a prior mean, with its standard deviation
spread = 0.1                                  10 % of the length if absent
give = 0.05                                   the distance changes by so much of the length; 0.05 if absent

[[rigid]]                                     all distances between these stay as they are, and are unknown
points = ["a", "b", "c"]
give = 0.001                                  0.001 if absent

[[pairs]]                                     limbs that a detector may take for each other
left = ["knee"]
right = ["knee_r"]
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from poseppl.errors import FilePath, Location, brief
from poseppl.files.bounded_reading import read_toml
from poseppl.motion.io.detections import MAX_POINTS, check_names
from poseppl.motion.io.text_parsing import LARGEST, some
from poseppl.motion.io.units_and_axes import mm_per_unit

GIVE, RIGID_GIVE = 0.05, 0.001
"""By how much of its length a link's distance changes, as a standard deviation, unless the file tells."""
SPREAD = 0.1
"""Standard deviation of a prior length, in units of it, unless the file tells."""
MAX_LINKS = 1000


class Link(NamedTuple):
    """Two points whose distance stays near a length.

    Attributes:
        ends: Their indices.
        length: Prior mean, mm; None where it is unknown.
        spread: Its standard deviation, mm; None likewise.
        give: Standard deviation of the distance around its length, as a share of it.
    """

    ends: tuple[int, int]
    length: float | None
    spread: float | None
    give: float


class Skeleton(NamedTuple):
    """Points, and what is known of them.

    Attributes:
        points: K names.
        links: Pairs of points with a nearly constant distance.
        pairs: For each pair of limbs, the indices of the left and of the right points.
    """

    points: tuple[str, ...]
    links: tuple[Link, ...]
    pairs: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def read_skeleton(path: FilePath) -> Skeleton:
    """Read a skeleton.

    Raises:
        InputError: The file is no TOML, or a field is unknown, missing or malformed; the message names it.
    """
    document, at = read_toml(path), Location(path)
    _check_fields(document, ("units", "points", "links", "rigid", "pairs"), at)
    points = _names(document.get("points"), at.in_field("points"))
    check_names(points, "points", at.in_field("points"))
    if len(points) > MAX_POINTS:
        raise at.in_field("points").error(f"{len(points)} points", f"at most {MAX_POINTS}")
    scale = mm_per_unit(document["units"], at.in_field("units")) if "units" in document else None
    links = [_link(table, where, points, scale) for table, where in _tables(document, "links", at)]
    for table, where in _tables(document, "rigid", at):
        links += _rigid(table, where, points)
    seen: set[tuple[int, int]] = set()
    for link in links:
        if link.ends in seen:
            first, second = (points[end] for end in link.ends)
            raise at.in_field("links").error(f"{first} and {second} are linked twice", "once, in links or in one rigid body")
        seen.add(link.ends)
    if len(links) > MAX_LINKS:
        raise at.in_field("links").error(f"{len(links)} links", f"at most {MAX_LINKS}")
    pairs = [_pair(table, where, points) for table, where in _tables(document, "pairs", at)]
    return Skeleton(points, tuple(links), tuple(pairs))


def _check_fields(table: Mapping[str, Any], known: Sequence[str], at: Location) -> None:
    for name in table:
        if name not in known:
            raise at.error(f"the field {brief(name)} is unknown", ", ".join(known))


def _tables(document: Mapping[str, Any], name: str, at: Location) -> list[tuple[Mapping[str, Any], Location]]:
    tables = document.get(name, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise at.in_field(name).error("not a list of tables", f"[[{name}]]")
    return [(table, at.in_field(f"{name}[{number}]")) for number, table in enumerate(tables)]


def _names(value: Any, at: Location) -> tuple[str, ...]:
    if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
        raise at.error("no list of names", '["hip", "knee", ...]')
    return tuple(value)


def _indices(value: Any, points: Sequence[str], at: Location) -> tuple[int, ...]:
    names = _names(value, at)
    for name in names:
        if name not in points:
            raise at.error(f"no point is called {brief(name)}", some(points))
    if len(set(names)) < len(names):
        raise at.error("a point comes twice", "each once")
    return tuple(points.index(name) for name in names)


def _positive(table: Mapping[str, Any], name: str, at: Location, most: float = LARGEST) -> float | None:
    value = table.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
        raise at.error(f"{name} is {brief(value)}", f"a positive number up to {most:g}")
    return float(value)


def _link(table: Mapping[str, Any], at: Location, points: Sequence[str], scale: float | None) -> Link:
    _check_fields(table, ("between", "length", "spread", "give"), at)
    ends = _indices(table.get("between"), points, at.in_field(f"{at.field}.between"))
    if len(ends) != 2:
        raise at.error(f"a link between {len(ends)} points", "two")
    length, spread = (_positive(table, name, at) for name in ("length", "spread"))
    give = _positive(table, "give", at, 1.0) or GIVE
    if length is None:
        if spread is not None:
            raise at.error("a spread without a length", "both, or neither")
        return Link(_ordered(ends), None, None, give)
    if scale is None:
        raise at.error("a length in no unit", 'units = "mm", at the top of the file')
    return Link(_ordered(ends), length * scale, (SPREAD * length if spread is None else spread) * scale, give)


def _ordered(ends: Sequence[int]) -> tuple[int, int]:
    first, second = sorted(ends)
    return first, second


def _rigid(table: Mapping[str, Any], at: Location, points: Sequence[str]) -> list[Link]:
    _check_fields(table, ("points", "give"), at)
    body = _indices(table.get("points"), points, at.in_field(f"{at.field}.points"))
    give = _positive(table, "give", at, 1.0) or RIGID_GIVE
    return [Link(_ordered(ends), None, None, give) for ends in itertools.combinations(body, 2)]


def _pair(table: Mapping[str, Any], at: Location, points: Sequence[str]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    _check_fields(table, ("left", "right"), at)
    left, right = (_indices(table.get(side), points, at.in_field(f"{at.field}.{side}")) for side in ("left", "right"))
    if len(left) != len(right) or set(left) & set(right):
        raise at.error(f"{len(left)} points on the left, {len(right)} on the right", "as many other ones, in the same order")
    return left, right
