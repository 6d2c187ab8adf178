"""Keypoints of people as OpenPose writes them: a folder with one JSON file a frame.

Each file lists the people that were found, ``{"people": [{"pose_keypoints_2d": [x, y, confidence, ...]}, ...]}``; a point at
0, 0 was not found. The last number in a file's name is its frame; frames without a file are frames in which nobody was seen.
How many points a person has tells the layout, but for BODY_25 and BODY_25B, which both have 25: there points 15 and 16 are
the eyes in one and the ankles in the other, which their distance from the nose tells.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, InputError, Location
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.detections import MAX_FRAMES, MAX_PEOPLE, DetectedPeople, detected_people
from poseppl.motion.io.keypoint_layouts import LAYOUTS
from poseppl.motion.io.text_parsing import LARGEST

_EYE, _NOSE, _TOE = 15, 0, 19
_NEAR = 0.3
"""Point 15 is an eye if it is nearer to the nose than this share of the nose's distance from a toe."""


def read_openpose(folder: FilePath, layout: str | None = None) -> DetectedPeople:
    """Read a folder of OpenPose's JSON files.

    Args:
        folder: The folder.
        layout: Which points these are; found from their number and places if None.

    Raises:
        InputError: The folder holds no such file, a file is malformed, or the number of points belongs to no layout.
    """
    files = _numbered_files(Path(folder))
    people = {number: _people(file) for number, file in files.items()}
    counts = {len(person) for found in people.values() for person in found}
    at = Location(folder)
    if not counts:
        raise at.error(f"nobody was found in any of {len(files)} files", "at least one person in one frame")
    if len(counts) > 1:
        raise at.error(f"people with {sorted(counts)} points", "one number of points in all files")
    found = detected_people(people, [str(number) for number in range(counts.pop())], at)
    chosen = layout_of(found.points, at) if layout is None else check_layout(layout, len(found.names), at)
    return found._replace(layout=chosen, names=LAYOUTS[chosen].names)


def layout_of(points: Floats, at: Location) -> str:
    """Which points (..., K, 2) these are.

    Raises:
        InputError: No layout has K points.
    """
    count = points.shape[-2]
    fitting = [name for name, layout in LAYOUTS.items() if layout.num_points == count]
    if not fitting:
        known = ", ".join(f"{name} ({layout.num_points})" for name, layout in LAYOUTS.items())
        raise at.error(f"people with {count} points", known)
    if fitting != ["body25", "body25b"]:
        return fitting[0]
    with np.errstate(invalid="ignore"):
        nose = points[..., _NOSE, :]
        ratio = np.linalg.norm(points[..., _EYE, :] - nose, axis=-1) / np.linalg.norm(points[..., _TOE, :] - nose, axis=-1)
    known = ratio[np.isfinite(ratio)]
    return "body25" if known.size and np.median(known) < _NEAR else "body25b"


def check_layout(layout: str, count: int, at: Location) -> str:
    """Check that a layout is known and has as many points.

    Raises:
        InputError: It is not, or has not.
    """
    if layout not in LAYOUTS:
        raise InputError(f"{layout!r}", field="--layout", expected=", ".join(LAYOUTS))
    if LAYOUTS[layout].num_points != count:
        raise at.error(f"people with {count} points", f"{LAYOUTS[layout].num_points}, as {layout} has")
    return layout


def _numbered_files(folder: Path) -> dict[int, Path]:
    at = Location(folder)
    if not folder.is_dir():
        raise at.error("no such folder", "a folder of OpenPose's JSON files, one a frame")
    found: dict[int, Path] = {}
    for file in sorted(folder.glob("*.json")):
        numbers = re.findall("[0-9]+", file.stem)
        if not numbers or len(numbers[-1]) > 12:
            raise Location(file).error(
                "no frame number in the file's name", "cam1_000000000012_keypoints.json, or cam1.0012.json"
            )
        number = int(numbers[-1])
        if number in found:
            raise Location(file).error(f"frame {number} is also {found[number].name}", "one file a frame")
        found[number] = file
    if not found:
        raise at.error("no JSON file in the folder", "OpenPose's JSON files, one a frame")
    if max(found) - min(found) >= MAX_FRAMES:
        raise at.error(f"frames {min(found)} to {max(found)}", f"at most {MAX_FRAMES} frames")
    return found


def _people(file: Path) -> list[Floats]:
    """Points (K, 3) of each person in a file; those without points, as some writers leave them, are left out."""
    at = Location(file)
    try:
        document: Any = json.loads(read_text(file))
    except (ValueError, RecursionError) as error:
        raise at.error(f"malformed JSON: {error}") from error
    people = document.get("people") if isinstance(document, dict) else None
    if not isinstance(people, list) or len(people) > MAX_PEOPLE:
        raise at.in_field("people").error("not a list of people", '{"people": [{"pose_keypoints_2d": [...]}]}')
    found = [_person(at.in_field(f"people[{index}].pose_keypoints_2d"), person) for index, person in enumerate(people)]
    return [person for person in found if len(person)]


def _person(at: Location, person: object) -> Floats:
    values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    if not isinstance(values, list) or len(values) % 3 or len(values) > 3000:
        raise at.error("not a list of x, y, confidence", "three numbers a point")
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise at.error("not a list of numbers", "x, y, confidence, x, y, ...")
    table = np.array([float(value) for value in values]).reshape(-1, 3)
    if np.any(np.abs(table[np.isfinite(table)]) > LARGEST):
        raise at.error("a number is too large", "pixels, at most 1e9")
    return table
