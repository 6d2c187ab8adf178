"""True places of named markers or joints over time as a CSV file, in millimetres, Z up.

A marker whose place is not known in a frame has no row.

    frame,marker,x,y,z
    0,knee_r,512.5,33.25,480.0
    0,knee_l,478.0,30.5,482.25
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import FilePath, Location, brief
from poseppl.files.atomic_writing import write_rows
from poseppl.files.csv_reading import rows_of_csv
from poseppl.motion.io.text_parsing import parse_frame, parse_number

COLUMNS = ("frame", "marker", "x", "y", "z")


def write_places(path: FilePath, frames: Integers, names: Sequence[str], places: Floats) -> None:
    """Write places, atomically; reading gives the same values back.

    Args:
        path: The CSV file.
        frames: (T,) frame numbers.
        names: K names.
        places: (T, K, 3) mm; NaN where unknown.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    seen = np.argwhere(np.isfinite(places).all(-1))
    write_rows(path, [COLUMNS, *([int(frames[t]), names[k], *places[t, k].tolist()] for t, k in seen)])


def read_places(path: FilePath, names: Sequence[str]) -> tuple[Integers, Floats]:
    """Read the places of some markers; others in the file are passed over.

    Args:
        path: The CSV file.
        names: K names.

    Returns:
        The numbers (T,) of the frames in the file, in order, and places (T, K, 3) in mm, NaN where there is no row.

    Raises:
        InputError: The file is empty, has other columns, repeats a place, or holds something that is not a finite number.
    """
    known = {name: index for index, name in enumerate(names)}
    rows: dict[tuple[int, str], tuple[float, ...]] = {}
    lines = rows_of_csv(path)
    at, header = next(lines, (Location(path, 1), []))
    if tuple(header) != COLUMNS:
        raise at.error(f"columns {brief(','.join(header))}", ",".join(COLUMNS))
    for at, row in lines:
        key, place = _row(at, row)
        if key in rows:
            raise at.error(f"frame {key[0]} has {brief(key[1])} twice")
        rows[key] = place
    if not rows:
        raise Location(path).error("the file has no position", "at least one row after the header")
    frames = np.array(sorted({frame for frame, _ in rows}), np.int64)
    places = np.full((len(frames), len(names), 3), np.nan)
    for (frame, name), place in rows.items():
        if name in known:
            places[np.searchsorted(frames, frame), known[name]] = place
    return frames, places


def _row(at: Location, row: list[str]) -> tuple[tuple[int, str], tuple[float, ...]]:
    place = tuple(parse_number(text, at.in_field(field)) for field, text in zip(COLUMNS[2:], row[2:], strict=True))
    return (parse_frame(row[0], at), row[1]), place
