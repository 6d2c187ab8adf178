"""Keypoints of people in JSON as OpenPose, AlphaPose, easy_ViTPose and MMPose write them.

How many points a person has tells the layout, but for BODY_25 and BODY_25B, which both have 25: there points 15 and 16 are
the eyes in one and the ankles in the other, which their distance from the nose tells. Others name their points.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import frame_number, numbered_files, numbers, read_json, same_points
from poseppl.motion.io.keypoint_layouts import with_layout


def read_openpose(folder: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read a folder of OpenPose's JSON files.

    Each file lists the people that were found, ``{"people": [{"pose_keypoints_2d": [x, y, confidence, ...]}, ...]}``; a point
    at 0, 0 was not found. The last number in a file's name is its frame; frames without a file are frames in which nobody was
    seen.

    Args:
        folder: The folder.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The folder holds no such file, a file is malformed, or the number of points belongs to no layout.
    """
    files, empty = numbered_files(folder, "a folder of OpenPose's JSON files, one a frame")
    people = {number: openpose_people(read_json(file), Location(file)) for number, file in files.items()}
    at = Location(folder)
    return with_layout(same_points(people | {frame: [] for frame in empty}, at, empty=empty), layout, at)


def openpose_people(document: Any, at: Location) -> list[Floats]:
    """Points (K, 3) of each person in a file; those without points, as some writers leave them, are left out.

    Raises:
        InputError: It is not OpenPose's.
    """
    people = document.get("people") if isinstance(document, dict) else None
    if not isinstance(people, list) or len(people) > MAX_PEOPLE:
        raise at.in_field("people").error("not a list of people", '{"people": [{"pose_keypoints_2d": [...]}]}')
    found = []
    for index, person in enumerate(people):
        values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
        found.append(numbers(values, 3, at.in_field(f"people[{index}].pose_keypoints_2d")))
    return [person for person in found if len(person)]


_ALPHAPOSE = 'AlphaPose\'s list, [{"image_id": "0.jpg", "keypoints": [x, y, confidence, ...]}, ...]'


def read_alphapose(path: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read AlphaPose's file.

    The document is a list of people, each with the picture that it was found in.

    Args:
        path: The file, ``alphapose-results.json``.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The file is malformed, or the number of points belongs to no layout.
    """
    document, at = read_json(path), Location(path)
    if not isinstance(document, list):
        raise at.error("no list of people", _ALPHAPOSE)
    people: dict[int, list[Floats]] = {}
    for index, person in enumerate(document):
        where = at.in_field(f"[{index}]")
        if not isinstance(person, dict):
            raise where.error("no person", _ALPHAPOSE)
        frame = frame_number(person.get("image_id"), where.in_field(f"[{index}].image_id"))
        found = people.setdefault(frame, [])
        found.append(numbers(person.get("keypoints"), 3, where.in_field(f"[{index}].keypoints")))
        if len(found) > MAX_PEOPLE:
            raise where.error(f"more than {MAX_PEOPLE} people in frame {frame}", f"at most {MAX_PEOPLE}")
    return with_layout(same_points(people, at), layout, at)


_VITPOSE = '{"keypoints": [{"0": [[y, x, confidence], ...]}, ...], "skeleton": {"0": "nose", ...}}'


def is_vitpose(document: Any) -> bool:
    """Whether a JSON document is one of easy_ViTPose."""
    return isinstance(document, dict) and isinstance(document.get("keypoints"), list) and "skeleton" in document


def read_vitpose(path: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read easy_ViTPose's predictions.

    One entry a frame, one list of points a track. The row of the picture comes before its column.

    Args:
        path: The file.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The file is malformed, or the number of points belongs to no layout and has no names.
    """
    document, at = read_json(path), Location(path)
    if not is_vitpose(document):
        raise at.error("no predictions of easy_ViTPose", _VITPOSE)
    people: dict[int, list[Floats]] = {}
    for frame, entry in enumerate(document["keypoints"]):
        where = at.in_field(f"keypoints[{frame}]")
        if not isinstance(entry, dict) or len(entry) > MAX_PEOPLE:
            raise where.error("no people by the number of their track", _VITPOSE)
        people[frame] = [numbers(points, 3, where)[:, [1, 0, 2]] for points in entry.values()]
    skeleton = document["skeleton"]
    known = isinstance(skeleton, dict) and all(isinstance(name, str) for name in skeleton.values())
    names = [skeleton.get(str(number), "") for number in range(len(skeleton))] if known else []
    return with_layout(same_points(people, at), layout, at, names if all(names) else ())


_MMPOSE = 'MMPose\'s predictions, [{"frame_id": 1, "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}]}]'


def read_mmpose(path: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read MMPose's predictions.

        {"meta_info": {"keypoint_id2name": {"0": "nose", ...}},
         "instance_info": [{"frame_id": 1, "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}, ...]}, ...]}

    The list of frames may be the whole document, and a frame may be a list of people alone.

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
        files, empty = numbered_files(path, _MMPOSE)
        documents = {frame: (read_json(file), Location(file)) for frame, file in files.items()}
        for frame, (document, where) in documents.items():
            people[frame] = mmpose_people(document, where)
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


def mmpose_people(document: Any, at: Location) -> list[Floats]:
    """Points (K, 3) of each person in a file of one frame.

    Raises:
        InputError: It is not MMPose's.
    """
    return _people(_frames_of(document, at), at)


def _frames_of(document: Any, at: Location) -> list[Any]:
    entries = document.get("instance_info") if isinstance(document, dict) else document
    if not isinstance(entries, list):
        raise at.error("no list of frames", _MMPOSE)
    return entries


def _people(instances: Any, at: Location) -> list[Floats]:
    if not isinstance(instances, list) or len(instances) > MAX_PEOPLE:
        raise at.error("not a list of people", _MMPOSE)
    return [_person(person, at.in_field(f"{at.field or ''}instances[{index}]")) for index, person in enumerate(instances)]


def _person(person: Any, at: Location) -> Floats:
    if not isinstance(person, dict) or "keypoints" not in person:
        raise at.error("no person", _MMPOSE)
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
