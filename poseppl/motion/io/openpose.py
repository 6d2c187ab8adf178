"""Keypoints of people as OpenPose writes them: a folder with one JSON file a frame.

Each file lists the people that were found, ``{"people": [{"pose_keypoints_2d": [x, y, confidence, ...]}, ...]}``; a point at
0, 0 was not found. The last number in a file's name is its frame; frames without a file are frames in which nobody was seen.
How many points a person has tells the layout, but for BODY_25 and BODY_25B, which both have 25: there points 15 and 16 are
the eyes in one and the ankles in the other, which their distance from the nose tells.
"""

from __future__ import annotations

from typing import Any

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import numbered_files, numbers, read_json, same_points
from poseppl.motion.io.layout_guess import with_layout


def read_openpose(folder: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read a folder of OpenPose's JSON files.

    Args:
        folder: The folder.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The folder holds no such file, a file is malformed, or the number of points belongs to no layout.
    """
    files, empty = numbered_files(folder, "a folder of OpenPose's JSON files, one a frame")
    people = {number: people_of_document(read_json(file), Location(file)) for number, file in files.items()}
    at = Location(folder)
    return with_layout(same_points(people | {frame: [] for frame in empty}, at, empty=empty), layout, at)


def people_of_document(document: Any, at: Location) -> list[Floats]:
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
