"""Points as MMPose writes them: one JSON file of all frames, or one a frame in a folder.

    {"meta_info": {"keypoint_id2name": {"0": "nose", ...}},
     "instance_info": [{"frame_id": 1, "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}, ...]}, ...]}

The list of frames may be the whole document, and a frame may be a list of people alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import frame_number, numbered_files, numbers, read_json, same_points
from poseppl.motion.io.layout_guess import with_layout

_EXPECTED = 'MMPose\'s predictions, [{"frame_id": 1, "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}]}]'


def read_mmpose(path: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read MMPose's predictions.

    Args:
        path: The file, or a folder with one file a frame.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The file is malformed, or the number of points belongs to no layout and has no names.
    """
    at = Location(path)
    people: dict[int, list[Floats]] = {}
    empty: list[int] = []
    if Path(path).is_dir():
        files, empty = numbered_files(path, _EXPECTED)
        documents = {frame: (read_json(file), Location(file)) for frame, file in files.items()}
        for frame, (document, where) in documents.items():
            people[frame] = people_of_document(document, where)
        people |= {frame: [] for frame in empty}
        names = _names(next(iter(documents.values()))[0])
    else:
        document = read_json(path)
        names = _names(document)
        for number, entry in enumerate(_frames_of(document, at)):
            where = at.in_field(f"instance_info[{number}]")
            inner = entry.get("instances") if isinstance(entry, dict) else entry
            frame = frame_number(entry["frame_id"], where) if isinstance(entry, dict) and "frame_id" in entry else number
            if frame in people:
                raise where.error(f"frame {frame} comes twice", "each once")
            people[frame] = _people(inner, where)
    return with_layout(same_points(people, at, empty=empty), layout, at, names)


def people_of_document(document: Any, at: Location) -> list[Floats]:
    """Points (K, 3) of each person in a file of one frame.

    Raises:
        InputError: It is not MMPose's.
    """
    return _people(_frames_of(document, at), at)


def _frames_of(document: Any, at: Location) -> list[Any]:
    entries = document.get("instance_info") if isinstance(document, dict) else document
    if not isinstance(entries, list):
        raise at.error("no list of frames", _EXPECTED)
    return entries


def _people(instances: Any, at: Location) -> list[Floats]:
    if not isinstance(instances, list) or len(instances) > MAX_PEOPLE:
        raise at.error("not a list of people", _EXPECTED)
    return [_person(person, at.in_field(f"{at.field or ''}instances[{index}]")) for index, person in enumerate(instances)]


def _person(person: Any, at: Location) -> Floats:
    if not isinstance(person, dict) or "keypoints" not in person:
        raise at.error("no person", _EXPECTED)
    points = person["keypoints"]
    scores = person.get("keypoint_scores")
    if scores is None:
        return numbers(points, 3, at.in_field(f"{at.field}.keypoints"))
    places = numbers(points, 2, at.in_field(f"{at.field}.keypoints"))
    certain = numbers(scores, 1, at.in_field(f"{at.field}.keypoint_scores"))
    if len(certain) != len(places):
        raise at.error(f"{len(places)} keypoints and {len(certain)} scores", "one score a keypoint")
    return np.concatenate([places, certain], 1)


def _names(document: Any) -> list[str]:
    """Names that the file has for the points, in order; none where it has none."""
    meta = document.get("meta_info") if isinstance(document, dict) else None
    table = meta.get("keypoint_id2name") if isinstance(meta, dict) else None
    if not isinstance(table, dict):
        return []
    named = [table.get(str(number)) for number in range(len(table))]
    return [name for name in named if isinstance(name, str)] if all(isinstance(name, str) for name in named) else []
