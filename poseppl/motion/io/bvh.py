"""BioVision hierarchy (BVH) recordings, through the library pybvh.

The text is checked line by line before the library sees it, so that a bad file is refused with its line and cannot make the
library exhaust the memory.

The format states no unit of length. The database of Carnegie Mellon in this format keeps the unit of its ASF skeletons, 1/0.45
inch = 56.444 mm; others write inches, centimetres, decimetres (MakeHuman) or metres. Without a scale the unit is taken that
brings the height of the skeleton at rest closest to 1.65 m, by ratio: right for adults, whose joints span 1.3 to 2 m.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.errors import FilePath, InputError, Location, PosepplError
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.bvh_translations import place_nodes, split_translations
from poseppl.motion.io.motion import Motion, to_z_up
from poseppl.motion.io.text_parsing import Line, lines_of_words, parse_number, parse_numbers

UNITS_MM = (1.0, 10.0, 25.4, 25.4 / 0.45, 100.0, 1000.0)
TYPICAL_HEIGHT_MM = 1650.0
MAX_JOINTS = 500
MAX_POINTS = 5_000_000


def read_bvh(path: FilePath, *, scale: float | None = None, up: str | None = None) -> Motion:
    """Read a BVH recording.

    Args:
        path: The .bvh file; each joint with three rotation channels, the root with three position channels besides,
            other joints with or without (see `bvh_translations`).
        scale: Millimetres in one unit of length; guessed by default (see the module), and then named in ``source``.
        up: The axis that points up, "x", "y" or "z"; inferred by pybvh from the first frame by default.

    Returns:
        The motion, Z up, in mm: joints and end sites ("NAME_end").

    Raises:
        InputError: The file is malformed, holds a value that is not finite, or has no height to guess the scale from.
        PosepplError: pybvh is not installed.
    """
    if scale is not None and not 1e-6 <= scale <= 1e6:
        raise InputError(f"{scale:g} mm a unit", field="scale", expected="a positive number")
    text = read_text(path)
    _check_text(path, text)
    text, translations = split_translations(path, text)
    clip = _parse(path, text, f"+{up}" if up else "auto")
    with np.errstate(all="ignore"):
        points = place_nodes(clip, translations)
        rest = np.asarray(clip.rest_pose_positions(), dtype=np.float64)
    # The inferred sign is not used: no system records head down, but a leg alone hangs from its root.
    axis = str(clip.world_up)[-1]
    height = float(np.ptp(rest[:, "xyz".index(axis)]))
    source = str(path)
    if scale is None:
        scale = _guess_scale(path, height)
        source = f"{path} (1 unit taken as {scale:.4g} mm)"
    if not np.all(np.isfinite(points)):
        raise InputError("positions are not finite", file=path)
    names, parents = _names(clip.nodes)
    return to_z_up(Motion(names, points * scale, parents, float(clip.fps), axis, source))


def _parse(path: FilePath, text: str, world_up: str) -> Any:
    try:
        import pybvh
    except ImportError as error:
        raise PosepplError("reading .bvh files needs pybvh: pip install 'poseppl[mocap]'") from error
    with tempfile.TemporaryDirectory(prefix="poseppl-") as folder:
        # The library reads the text that was checked; it insists on a lower-case suffix and the system's encoding.
        copy = Path(folder) / "motion.bvh"
        copy.write_text(text)
        try:
            with np.errstate(all="ignore"):
                return pybvh.read_bvh_file(copy, world_up=world_up, warn_on_world_up_disagreement=False)
        except Exception as error:
            raise InputError(f"pybvh refuses it: {str(error).replace(str(copy), 'the file')}", file=path) from error


def _guess_scale(path: FilePath, height: float) -> float:
    if not height > 1e-6:
        raise Location(path, field="scale").error("the skeleton has no height to guess its unit from", "mm a unit")
    return min(UNITS_MM, key=lambda unit: abs(math.log(unit * height / TYPICAL_HEIGHT_MM)))


def _names(nodes: list[Any]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    names: list[str] = []
    index: dict[int, int] = {}
    for node in nodes:
        name = f"{node.parent.name}_end" if node.is_end_site() else node.name
        while name in names:
            name += "_"
        index[id(node)] = len(names)
        names.append(name)
    parents = (-1 if node.parent is None else index[id(node.parent)] for node in nodes)
    return tuple(names), tuple(parents)


def _check_text(path: FilePath, text: str) -> None:
    lines = lines_of_words(path, text)
    if next(lines, (None, [""]))[1][0] != "HIERARCHY":
        raise Location(path, 1).error("no HIERARCHY", "a BioVision recording (.bvh)")
    found: list[Location] = []

    def before_motion() -> Iterator[Line]:
        for at, words in lines:
            if words[0] == "MOTION":
                found.append(at)
                return
            yield at, words

    channels, points = _check_hierarchy(path, before_motion())
    if not found:
        raise InputError("no MOTION section; is the file truncated?", file=path)
    _check_motion(found[0], lines, channels, points)


def _check_hierarchy(path: FilePath, lines: Iterator[Line]) -> tuple[int, int]:
    names: set[str] = set()
    channels = depth = points = 0
    for at, words in lines:
        key, rest = words[0], words[1:]
        if key in ("ROOT", "JOINT"):
            if len(rest) != 1 or rest[0] in names:
                raise at.in_field(key).error("a joint without one name of its own", "NAME")
            names.add(rest[0])
            points += 1
        elif key == "End":
            points += 1
        elif key == "OFFSET":
            if len(rest) != 3:
                raise at.in_field("OFFSET").error(f"{len(rest)} values", "3 numbers")
            parse_numbers(rest, at.in_field("OFFSET"))
        elif key == "CHANNELS":
            if not rest or rest[0] != str(len(rest) - 1):
                raise at.in_field("CHANNELS").error("the count differs from the list")
            channels += len(rest) - 1
        elif words in (["{"], ["}"]):
            depth += 1 if key == "{" else -1
        else:
            raise at.error(f"{key[:40]!r} is no part of a hierarchy")
        if depth < 0 or points > MAX_JOINTS:
            raise at.error("a } too many" if depth < 0 else f"more than {MAX_JOINTS} joints")
    if depth or not points:
        raise InputError("the hierarchy is not closed" if depth else "the hierarchy is empty", file=path)
    return channels, points


def _check_motion(at: Location, lines: Iterator[Line], channels: int, points: int) -> None:
    heads = list(itertools.islice(lines, 2))
    if [words[: 1 + i] for i, (_, words) in enumerate(heads)] != [["Frames:"], ["Frame", "Time:"]]:
        raise at.error("no lines Frames: and Frame Time: after MOTION")
    (at, frames), (at_time, time) = heads
    if len(frames) != 2 or not frames[1].isascii() or not frames[1].isdigit() or len(frames[1]) > 9:
        raise at.in_field("Frames:").error("no number of frames", "a whole number")
    at_time = at_time.in_field("Frame Time:")
    seconds = parse_number(" ".join(time[2:]), at_time)
    if not 1e-5 <= seconds <= 100.0:
        raise at_time.error(f"{seconds:g} s", "a positive time in s")
    count = 0
    for at, words in lines:
        if len(words) != channels:
            raise at.error(f"{len(words)} values", f"{channels}, one a channel")
        parse_numbers(words, at)
        count += 1
    if count != int(frames[1]) or not count:
        raise at.error(f"{count} frames; is the file truncated?", f"{frames[1]}, as Frames: says")
    if count * points > MAX_POINTS:
        raise at._replace(line=None).error(f"{count} frames of {points} joints", f"at most {MAX_POINTS} positions")
