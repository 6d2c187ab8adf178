"""Points as Caliscope (once Pyxy3D) writes them: one CSV file for all cameras, one row a point.

    sync_index,cam_id,object_id,keypoint_id,img_loc_x,img_loc_y,obj_loc_x,...
    35,0,0,0,577.268311,305.517639,0.054,...

Older files have ``port`` for ``cam_id``, ``point_id`` for ``keypoint_id``, and ``frame_time``, seconds. A row is a point that
was found, so that its confidence is 1. Cameras go by their number, as the tables ``[cameras.0]`` of ``camera_array.toml`` do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.csv_fields import rows_of_csv
from poseppl.motion.io.camera_fields import MAX_CAMERAS
from poseppl.motion.io.detections import MAX_PEOPLE, MAX_POINTS, DetectedPeople, check_room, detected_people
from poseppl.motion.io.text_parsing import parse_frame, parse_number

_COLUMNS = {
    "frame": ("sync_index",),
    "camera": ("cam_id", "port"),
    "person": ("object_id",),
    "point": ("keypoint_id", "point_id"),
    "x": ("img_loc_x",),
    "y": ("img_loc_y",),
    "time": ("frame_time",),
}
_OPTIONAL = ("person", "time")
_EXPECTED = "sync_index, cam_id, keypoint_id, img_loc_x, img_loc_y"


class _Point(NamedTuple):
    """A row: where it stands, and what it says."""

    at: Location
    frame: int
    camera: str
    person: int
    point: int
    place: tuple[float, float]
    time: float


def read_caliscope_points(path: FilePath) -> dict[str, DetectedPeople]:
    """Read the points of all cameras.

    Args:
        path: The file, such as ``xy_CHARUCO.csv``.

    Returns:
        The points by the number of the camera, as a text; they are named by their numbers, and so are ``individuals``.

    Raises:
        InputError: The file lacks a column, has a point twice, or holds what is no number; the message tells the line.
    """
    lines = rows_of_csv(path)
    at, header = next(lines, (Location(path), []))
    columns = _columns(at, header)
    rows = [_point(here, {field: row[column] for field, column in columns.items()}) for here, row in lines]
    if not rows:
        raise Location(path).error("the file has no point", "at least one row after the header")
    cameras: dict[str, list[_Point]] = {}
    for row in rows:
        cameras.setdefault(row.camera, []).append(row)
    if len(cameras) > MAX_CAMERAS:
        raise Location(path).error(f"points of {len(cameras)} cameras", f"at most {MAX_CAMERAS}")
    count = max(row.point for row in rows) + 1
    names = sorted(cameras, key=lambda name: (len(name), name))
    return {name: _camera(cameras[name], count, Location(path)) for name in names}


def _columns(at: Location, header: list[str]) -> dict[str, int]:
    found = {}
    for field, names in _COLUMNS.items():
        places = [header.index(name) for name in names if name in header]
        if places:
            found[field] = places[0]
        elif field not in _OPTIONAL:
            raise at.in_field(names[0]).error("the column is missing", _EXPECTED)
    return found


def _point(at: Location, words: Mapping[str, str]) -> _Point:
    person, point = (_number(words.get(field) or "0", field, at) for field in ("person", "point"))
    if person >= MAX_PEOPLE or point >= MAX_POINTS:
        raise at.error(f"object {person}, keypoint {point}", f"at most {MAX_PEOPLE - 1} and {MAX_POINTS - 1}")
    x, y, time = (
        parse_number(words[field], at.in_field(_COLUMNS[field][0])) if words.get(field) or field != "time" else math.nan
        for field in ("x", "y", "time")
    )
    number = str(_number(words["camera"], "camera", at))
    return _Point(at, parse_frame(words["frame"], at), number, person, point, (x, y), time)


def _number(token: str, kind: str, at: Location) -> int:
    if not (token.isascii() and token.isdigit() and len(token) <= 9):
        raise at.in_field(_COLUMNS[kind][0]).error(f"{brief(token)} is no number of a {kind}", "0, 1, 2, ...")
    return int(token)


def _camera(rows: list[_Point], count: int, at: Location) -> DetectedPeople:
    people: dict[int, list[Floats]] = {}
    times = {row.frame: row.time for row in rows}
    seen: set[tuple[int, int, int]] = set()
    check_room(len(times), max(row.person for row in rows) + 1, count, at)
    for row in rows:
        key = (row.frame, row.person, row.point)
        if key in seen:
            raise row.at.error(f"frame {row.frame} has keypoint {row.point} of camera {row.camera} twice", "each once")
        seen.add(key)
        found = people.setdefault(row.frame, [])
        while len(found) <= row.person:
            found.append(np.full((count, 3), np.nan))
        found[row.person][row.point] = [*row.place, 1.0]
    clock = times if np.isfinite(list(times.values())).any() else None
    objects = [str(number) for number in range(max(map(len, people.values())))]
    return detected_people(people, [str(number) for number in range(count)], at, individuals=objects, times=clock)
