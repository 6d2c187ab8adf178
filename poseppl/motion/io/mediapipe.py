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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.csv_fields import rows_of_csv
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import frame_number, number, read_json, same_points
from poseppl.motion.io.keypoint_layouts import LAYOUTS, plain_name, with_layout
from poseppl.motion.io.text_parsing import parse_number

NAMES = LAYOUTS["mediapipe33"]
_COUNT = len(NAMES)
_FRAME, _LISTS = ("frame", "frame_id", "frame_number", "frame_index"), ("landmarks", "pose_landmarks", "poseLandmarks", "poses")
_TIMES = {"timestamp_ms": 1e-3, "timestamp": 1.0, "time": 1.0}
_CERTAIN = ("visibility", "presence", "confidence", "score")
_EXPECTED = '33 landmarks a person, [{"frame": 0, "landmarks": [{"x": 0.5, "y": 0.2, "visibility": 0.9}, ...]}, ...]'
_COLUMNS = "frame, nose_x, nose_y, nose_visibility, ...; or frame, landmark, x, y, visibility"
_UNSEEN = {"x": None, "y": None}
_Frame = tuple[Location, Mapping[str, Any]]
"""Position of a frame, and its fields."""
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
    is_csv = Path(path).suffix.lower() == ".csv"
    people, clock = _people(_frames_of_csv(path) if is_csv else _frames_of_json(read_json(path), at))
    found = with_layout(same_points(people, at, clock or None), "mediapipe33", at)
    known = np.abs(found.points[np.isfinite(found.points)])
    if known.size and np.quantile(known, 0.99) > _LARGEST_SHARE:
        return found
    if size is None:
        raise at.error("coordinates are shares of the picture's size, which is unknown", "the camera's size in the calibration")
    return found._replace(points=found.points * np.array(size, float))


def _people(frames: Iterable[_Frame]) -> tuple[dict[int, list[Floats]], dict[int, float]]:
    """People, and seconds, by the number of the frame."""
    people: dict[int, list[Floats]] = {}
    clock: dict[int, float] = {}
    for at, fields in frames:
        frame = frame_number(_first(fields, _FRAME), at)
        if frame in people:
            raise at.error(f"frame {frame} comes twice", "each once")
        for key in [key for key in _TIMES if fields.get(key, "") != ""][:1]:
            clock[frame] = _TIMES[key] * _value(fields[key], at.in_field(f"{at.field or ''}.{key}".lstrip(".")))
        people[frame] = _poses(_first(fields, _LISTS), at)
    return people, clock


def _first(fields: Mapping[str, Any], names: Sequence[str], default: Any = None) -> Any:
    return next((fields[name] for name in names if name in fields), default)


def _value(value: Any, at: Location) -> float:
    """A number of JSON, or as text of a table; NaN where there is none."""
    if not isinstance(value, str):
        return number(value, at)
    return float("nan") if value.lower() in ("", "nan") else parse_number(value, at)


def _frames_of_json(document: Any, at: Location) -> Iterator[_Frame]:
    frames = document.get("frames") if isinstance(document, dict) else document
    if not isinstance(frames, list):
        raise at.error("no list of frames", _EXPECTED)
    for index, entry in enumerate(frames):
        fields = entry if isinstance(entry, dict) else {"landmarks": entry}
        yield at.in_field(f"frames[{index}]"), {"frame": _first(fields, _FRAME, index)} | fields


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
        where = at.in_field(f"{at.field or ''}.landmarks[{index}]".lstrip("."))
        if isinstance(landmark, list) and len(landmark) in (3, 4):
            rows.append([_value(landmark[i], where) for i in (0, 1, -1)])
            if rows[-1][2] < 0:
                raise where.error("a visibility below 0, as depths may be", "x, y, visibility; or x, y, z, visibility")
        elif isinstance(landmark, dict) and {"x", "y"} <= set(landmark):
            certain = next((landmark[key] for key in _CERTAIN if landmark.get(key) is not None), 1.0)
            rows.append([_value(value, where) for value in (landmark["x"], landmark["y"], certain)])
        else:
            raise where.error("no landmark", '{"x": 0.5, "y": 0.2, "visibility": 0.9}')
    return np.array(rows)


def _frames_of_csv(path: FilePath) -> Iterable[_Frame]:
    """The rows of a table in the form of JSON's frames."""
    lines = rows_of_csv(path)
    at, header = next(lines, (Location(path), []))
    fields = [name.lower() for name in header]
    if not set(_FRAME) & set(fields):
        raise at.error("no column frame", _COLUMNS)
    rows = ((here, dict(zip(fields, row, strict=True))) for here, row in lines)
    which = [name for name in ("landmark", "landmark_id") if name in fields]
    if not which:
        columns = _wide_columns(fields, at)
        return (
            (here, row | {"landmarks": [{kind: row[of] for kind, of in each.items()} for each in columns]})
            for here, row in rows
        )
    if not {"x", "y"} <= set(fields):
        raise at.error("no columns x and y", _COLUMNS)
    frames: dict[int, _Frame] = {}
    for here, row in rows:
        frame, index = frame_number(_first(row, _FRAME), here), _landmark(row[which[0]], here)
        landmarks = frames.setdefault(frame, (here, row | {"landmarks": [_UNSEEN] * _COUNT}))[1]["landmarks"]
        if landmarks[index] is not _UNSEEN:
            raise here.error(f"landmark {NAMES[index]} of frame {frame} comes twice", "one row a landmark")
        landmarks[index] = {key: _value(row[key], here.in_field(key)) for key in ("x", "y", *_CERTAIN) if key in row}
    return frames.values()


def _wide_columns(fields: Sequence[str], at: Location) -> list[dict[str, str]]:
    """Columns of each landmark, by x, y and visibility."""
    found: dict[str, dict[str, str]] = {name: {} for name in NAMES}
    for field in fields:
        name, _, kind = field.rpartition("_")
        known = _name(name)
        if known is not None and kind in ("x", "y", *_CERTAIN):
            found[known][kind] = field
    missing = [name for name in NAMES if not {"x", "y"} <= set(found[name])]
    if missing:
        raise at.error(f"no columns {missing[0]}_x and {missing[0]}_y", _COLUMNS)
    return list(found.values())


def _landmark(word: str, at: Location) -> int:
    name = _name(word)
    if name is None:
        raise at.in_field("landmark").error(brief(word), f"0 to {_COUNT - 1}, or a name such as left_shoulder")
    return NAMES.index(name)


def _name(word: str) -> str | None:
    """A landmark by its number, as "11", or by its name."""
    digits = re.fullmatch("(?:landmark_?)?([0-9]{1,2})", word.strip().lower())
    if digits:
        return NAMES[int(digits[1])] if int(digits[1]) < _COUNT else None
    name = plain_name(word)
    return name if name in NAMES else None
