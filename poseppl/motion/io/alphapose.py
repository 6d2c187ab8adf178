"""Points as AlphaPose writes them: one JSON file, a list of people, each with the picture that it was found in.

The document is

    [{"image_id": "12.jpg", "category_id": 1, "keypoints": [x, y, confidence, ...], "score": 2.9, "idx": 1}, ...]
"""

from __future__ import annotations

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import frame_number, numbers, read_json, same_points
from poseppl.motion.io.layout_guess import with_layout

_EXPECTED = 'AlphaPose\'s list, [{"image_id": "0.jpg", "keypoints": [x, y, confidence, ...]}, ...]'


def read_alphapose(path: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read AlphaPose's file.

    Args:
        path: The file, ``alphapose-results.json``.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The file is malformed, or the number of points belongs to no layout.
    """
    document, at = read_json(path), Location(path)
    if not isinstance(document, list):
        raise at.error("no list of people", _EXPECTED)
    people: dict[int, list[Floats]] = {}
    for index, person in enumerate(document):
        where = at.in_field(f"[{index}]")
        if not isinstance(person, dict):
            raise where.error("no person", _EXPECTED)
        frame = frame_number(person.get("image_id"), where.in_field(f"[{index}].image_id"))
        found = people.setdefault(frame, [])
        found.append(numbers(person.get("keypoints"), 3, where.in_field(f"[{index}].keypoints")))
        if len(found) > MAX_PEOPLE:
            raise where.error(f"more than {MAX_PEOPLE} people in frame {frame}", f"at most {MAX_PEOPLE}")
    return with_layout(same_points(people, at), layout, at)
