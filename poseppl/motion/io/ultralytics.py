"""Points as Ultralytics writes them (``save_txt=True``): a folder of text files, one a picture, one line a person.

    0 0.5 0.5 0.2 0.6 0.522 0.345 0.84 0.528 0.343 0.72 ...

The class, the box (centre, width, height), then x and y of each point, as shares of the picture's width and height, with its
confidence where the model has one; then the confidence of the box (``save_conf=True``) and the number of the track, where there
are any. Pictures without a person have no file. The last number in a file's name is its frame.
"""

from __future__ import annotations

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, InputError, Location
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.detections import MAX_PEOPLE, DetectedPeople
from poseppl.motion.io.json_people import numbered_files, same_points
from poseppl.motion.io.keypoint_layouts import LAYOUTS, with_layout
from poseppl.motion.io.text_parsing import lines_of_words, parse_numbers

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
