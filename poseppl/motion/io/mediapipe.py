"""The 33 landmarks of MediaPipe's pose, as JSON or CSV.

MediaPipe has no files of its own; these are the forms that people write.

JSON: a list of frames, or ``{"frames": [...]}``, each with its landmarks, or those of several people:

    [{"frame": 0, "timestamp_ms": 0, "landmarks": [{"x": 0.51, "y": 0.22, "z": -0.3, "visibility": 0.99}, ...]}, ...]

CSV: a column ``frame``, and for each landmark ``nose_x, nose_y, nose_visibility``; or a row a landmark, ``frame, landmark,
x, y, visibility``, where the landmark is a number or a name. ``timestamp`` or ``time`` are seconds, ``timestamp_ms``
milliseconds.

Coordinates are shares of the picture's width and height where nearly all lie between 0 and 1, and pixels otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import frame_number, number, read_json, same_points
from poseppl.motion.io.keypoint_layouts import LAYOUTS, plain_name
from poseppl.motion.io.layout_guess import with_layout
from poseppl.motion.io.text_parsing import parse_frame, parse_number, rows_of_csv

NAMES = LAYOUTS["mediapipe33"].names
_COUNT = len(NAMES)
_FRAME, _LISTS = ("frame", "frame_id", "frame_number", "frame_index"), ("landmarks", "pose_landmarks", "poseLandmarks", "poses")
_TIMES = {"timestamp_ms": 1e-3, "timestamp": 1.0, "time": 1.0}
_CERTAIN = ("visibility", "presence", "confidence", "score")
_EXPECTED = '33 landmarks a person, [{"frame": 0, "landmarks": [{"x": 0.5, "y": 0.2, "visibility": 0.9}, ...]}, ...]'
_COLUMNS = "frame, nose_x, nose_y, nose_visibility, ...; or frame, landmark, x, y, visibility"
_LARGEST_SHARE = 3.0
"""Landmarks of people who are partly outside of the picture are guessed there."""


def read_mediapipe(path: FilePath, size: tuple[int, int] | None = None) -> DetectedPeople:
    """Read MediaPipe's landmarks.

    Args:
        path: A JSON or CSV file.
        size: Width and height of the pictures in pixels; needed where coordinates are shares of them.

    Raises:
        InputError: The file is malformed, people have another number of landmarks than 33, or ``size`` is missing.
    """
    at = Location(path)
    clock: dict[int, float] = {}
    people = _csv_people(path, clock) if Path(path).suffix.lower() == ".csv" else _json_people(read_json(path), at, clock)
    found = with_layout(same_points(people, at, clock or None), "mediapipe33", at)
    known = np.abs(found.points[np.isfinite(found.points)])
    if known.size and np.quantile(known, 0.99) > _LARGEST_SHARE:
        return found
    if size is None:
        raise at.error("coordinates are shares of the picture's size, which is unknown", "the camera's size in the calibration")
    return found._replace(points=found.points * np.array(size, float))


def _json_people(document: Any, at: Location, clock: dict[int, float]) -> dict[int, list[Floats]]:
    frames = document.get("frames") if isinstance(document, dict) else document
    if not isinstance(frames, list):
        raise at.error("no list of frames", _EXPECTED)
    people: dict[int, list[Floats]] = {}
    for index, entry in enumerate(frames):
        where = at.in_field(f"frames[{index}]")
        fields: Mapping[str, Any] = entry if isinstance(entry, dict) else {"landmarks": entry}
        told = next((fields[key] for key in _FRAME if key in fields), index)
        frame = frame_number(told, where)
        if frame in people:
            raise where.error(f"frame {frame} comes twice", "each once")
        for key, unit in _TIMES.items():
            if key in fields:
                clock[frame] = unit * number(fields[key], where.in_field(f"frames[{index}].{key}"))
                break
        people[frame] = _poses(next((fields[key] for key in _LISTS if key in fields), None), where)
    return people


def _poses(found: Any, at: Location) -> list[Floats]:
    """The people of a frame: a list of landmarks, or of such lists; nobody where there is none."""
    if found is None or found == []:
        return []
    if not isinstance(found, list):
        raise at.error("no list of landmarks", _EXPECTED)
    several = isinstance(found[0], list) and (not found[0] or isinstance(found[0][0], dict | list))
    poses = [pose for pose in found if pose != []] if several else [found]
    if len(poses) > MAX_PEOPLE:
        raise at.error(f"{len(poses)} people", f"at most {MAX_PEOPLE}")
    return [_pose(pose, at) for pose in poses]


def _pose(landmarks: Any, at: Location) -> Floats:
    if not isinstance(landmarks, list) or len(landmarks) != _COUNT:
        count = len(landmarks) if isinstance(landmarks, list) else 0
        raise at.error(f"{count} landmarks", _EXPECTED)
    rows = []
    for index, landmark in enumerate(landmarks):
        where = at.in_field(f"{at.field}.landmarks[{index}]")
        if isinstance(landmark, list) and len(landmark) in (3, 4):
            rows.append([number(landmark[i], where) for i in (0, 1, -1)])
        elif isinstance(landmark, dict) and {"x", "y"} <= set(landmark):
            certain = next((landmark[key] for key in _CERTAIN if landmark.get(key) is not None), 1.0)
            rows.append([number(value, where) for value in (landmark["x"], landmark["y"], certain)])
        else:
            raise where.error("no landmark", '{"x": 0.5, "y": 0.2, "visibility": 0.9}')
    return np.array(rows)


def _csv_people(path: FilePath, clock: dict[int, float]) -> dict[int, list[Floats]]:
    lines = rows_of_csv(path)
    at, header = next(lines, (Location(path), []))
    fields = [name.lower() for name in header]
    frame_column = next((fields.index(name) for name in _FRAME if name in fields), None)
    if frame_column is None:
        raise at.error("no column frame", _COLUMNS)
    long = "landmark" in fields or "landmark_id" in fields
    columns = _long_columns(fields, at) if long else _wide_columns(fields, at)
    time = next(((fields.index(name), unit) for name, unit in _TIMES.items() if name in fields), None)
    people: dict[int, list[Floats]] = {}
    for where, row in lines:
        if len(row) != len(fields):
            raise where.error(f"{len(row)} values", f"{len(fields)}, one a column; the file may have been cut off")
        frame = parse_frame(row[frame_column], where)
        if time is not None and row[time[0]]:
            clock[frame] = time[1] * parse_number(row[time[0]], where.in_field(fields[time[0]]))
        if not long and frame in people:
            raise where.error(f"frame {frame} comes twice", "one row a frame")
        pose = people.setdefault(frame, [np.full((_COUNT, 3), np.nan)])[0]
        for point, places in columns.items():
            index = _landmark(row[point], where) if isinstance(point, int) else NAMES.index(point)
            if long and np.isfinite(pose[index, :2]).any():
                raise where.error(f"landmark {NAMES[index]} of frame {frame} comes twice", "one row a landmark")
            pose[index] = [_value(row, column, where) for column in places]
    return people


def _value(row: Sequence[str], column: int | None, at: Location) -> float:
    if column is None:
        return 1.0
    return float("nan") if row[column].lower() in ("", "nan") else parse_number(row[column], at)


def _long_columns(fields: list[str], at: Location) -> dict[int | str, tuple[int | None, ...]]:
    if "x" not in fields or "y" not in fields:
        raise at.error("no columns x and y", _COLUMNS)
    which = fields.index("landmark" if "landmark" in fields else "landmark_id")
    certain = next((fields.index(name) for name in _CERTAIN if name in fields), None)
    return {which: (fields.index("x"), fields.index("y"), certain)}


def _wide_columns(fields: list[str], at: Location) -> dict[int | str, tuple[int | None, ...]]:
    found: dict[str, dict[str, int]] = {}
    for column, field in enumerate(fields):
        name, _, kind = field.rpartition("_")
        known = _name(name)
        if known is not None and kind in ("x", "y", *_CERTAIN):
            found.setdefault(known, {})["certain" if kind in _CERTAIN else kind] = column
    missing = [name for name in NAMES if not {"x", "y"} <= set(found.get(name, {}))]
    if missing:
        raise at.error(f"no columns {missing[0]}_x and {missing[0]}_y", _COLUMNS)
    return {name: (found[name]["x"], found[name]["y"], found[name].get("certain")) for name in NAMES}


def _landmark(word: str, at: Location) -> int:
    name = _name(word)
    if name is None:
        raise at.in_field("landmark").error(f"{word[:40]!r}", f"0 to {_COUNT - 1}, or a name such as left_shoulder")
    return NAMES.index(name)


def _name(word: str) -> str | None:
    """A landmark by its number, as "11", or by its name."""
    digits = re.fullmatch("(?:landmark_?)?([0-9]{1,2})", word.strip().lower())
    if digits:
        return NAMES[int(digits[1])] if int(digits[1]) < _COUNT else None
    name = plain_name(word)
    return name if name in NAMES else None
