"""Points as easy_ViTPose writes them (its JSON): one JSON file, one entry a frame, one list of points a track.

    {"keypoints": [{"0": [[y, x, confidence], ...], "3": ...}, ...], "skeleton": {"0": "nose", ...}}

The row of the picture comes before its column.
"""

from __future__ import annotations

from typing import Any

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import numbers, read_json, same_points
from poseppl.motion.io.layout_guess import with_layout

_EXPECTED = '{"keypoints": [{"0": [[y, x, confidence], ...]}, ...], "skeleton": {"0": "nose", ...}}'


def is_vitpose(document: Any) -> bool:
    """Whether a JSON document is one of easy_ViTPose."""
    return isinstance(document, dict) and isinstance(document.get("keypoints"), list) and "skeleton" in document


def read_vitpose(path: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read easy_ViTPose's predictions.

    Args:
        path: The file.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The file is malformed, or the number of points belongs to no layout and has no names.
    """
    document, at = read_json(path), Location(path)
    if not is_vitpose(document):
        raise at.error("no predictions of easy_ViTPose", _EXPECTED)
    people: dict[int, list[Floats]] = {}
    for frame, entry in enumerate(document["keypoints"]):
        where = at.in_field(f"keypoints[{frame}]")
        if not isinstance(entry, dict) or len(entry) > MAX_PEOPLE:
            raise where.error("no people by the number of their track", _EXPECTED)
        people[frame] = [numbers(points, 3, where)[:, [1, 0, 2]] for points in entry.values()]
    skeleton = document["skeleton"]
    known = isinstance(skeleton, dict) and all(isinstance(name, str) for name in skeleton.values())
    names = [skeleton.get(str(number), "") for number in range(len(skeleton))] if known else []
    return with_layout(same_points(people, at), layout, at, names if all(names) else ())
