"""Points as text tables: Caliscope's CSV of all cameras, and Ultralytics' folder of a file a picture.

A row of Caliscope (once Pyxy3D) is a point that was found, so that its confidence is 1:

    sync_index,cam_id,object_id,keypoint_id,img_loc_x,img_loc_y,obj_loc_x,...
    35,0,0,0,577.268311,305.517639,0.054,...

Older files have ``port`` for ``cam_id``, ``point_id`` for ``keypoint_id``, and ``frame_time``, seconds. Cameras go by their
number, as the tables ``[cameras.0]`` of ``camera_array.toml`` do.

A line of Ultralytics (``save_txt=True``) is a person:

    0 0.5 0.5 0.2 0.6 0.522 0.345 0.84 0.528 0.343 0.72 ...

These are the class, the box (centre, width, height), then x and y of each point, as shares of the picture's width and height,
with its confidence where the model has one; then the confidence of the box (``save_conf=True``) and the number of the track,
where there are any. Pictures without a person have no file. The last number in a file's name is its frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, InputError, Location, brief
from poseppl.files.bounded_reading import read_text
from poseppl.files.csv_fields import rows_of_csv
from poseppl.motion.io.camera_fields import MAX_CAMERAS
from poseppl.motion.io.detections import MAX_PEOPLE, MAX_POINTS, DetectedPeople, check_room, detected_people
from poseppl.motion.io.json_people import numbered_files, same_points
from poseppl.motion.io.keypoint_layouts import LAYOUTS, with_layout
from poseppl.motion.io.text_parsing import lines_of_words, parse_frame, parse_number, parse_numbers

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


EXPECTED = "a folder of Ultralytics' text files, one a frame: class, box, and x, y, confidence of each point"
_BOX = 5
"""Numbers before the first point."""
_USUAL, _LENGTHS = len(LAYOUTS["coco17"]), {len(names) for names in LAYOUTS.values()}
"""Numbers of points: those of Ultralytics' own models, and of all layouts. The form of a line is found with them."""


def read_ultralytics(folder: FilePath, layout: str | None = None, size: tuple[int, int] | None = None) -> DetectedPeople:
    """Read a folder of Ultralytics' text files.

    Args:
        folder: The folder.
        layout: Which points these are; found from their number and places if None.
        size: Width and height of the pictures, px.

    Raises:
        InputError: A file is malformed, the size is not known, or the number of points belongs to no layout.
    """
    at = Location(folder)
    if size is None:
        raise InputError("the points are shares of a picture whose size is not known", file=folder, expected="size=(W, H)")
    files, unseen = numbered_files(folder, EXPECTED, ".txt")
    people = {frame: _people(file, size) for frame, file in files.items()} | {frame: [] for frame in unseen}
    return with_layout(same_points(people, at, empty=unseen), layout, at)


def _people(file: FilePath, size: tuple[int, int]) -> list[Floats]:
    """Points (K, 3) of the people of a picture."""
    people: list[Floats] = []
    for at, words in lines_of_words(file, read_text(file)):
        if len(people) == MAX_PEOPLE:
            raise at.error(f"more than {MAX_PEOPLE} people", EXPECTED)
        people.append(_person(np.array(parse_numbers(words, at)), at) * (*size, 1.0))
    return people


def _person(numbers: Floats, at: Location) -> Floats:
    """Points (K, 3) of a line, whose form is the likeliest one of so many numbers."""
    count = len(numbers) - _BOX
    forms = [((count - more) // width, width) for width in (3, 2) for more in (0, 1, 2) if (count - more) % width == 0]
    forms = [(points, width) for points, width in forms if points > 0]
    if not forms:
        raise at.error(f"{len(numbers)} numbers", EXPECTED)
    points, width = min(forms, key=lambda form: (form[0] != _USUAL, form[0] not in _LENGTHS))
    table = numbers[_BOX : _BOX + points * width].reshape(points, width)
    return table if width == 3 else np.concatenate([table, np.ones((points, 1))], axis=1)
