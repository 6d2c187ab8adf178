"""BioVision hierarchy (BVH) recordings, through the library pybvh.

The text is checked line by line before the library sees it, so that a bad file is refused with its line and cannot make the
library exhaust the memory.

The format states no unit of length. The database of Carnegie Mellon in this format keeps the unit of its ASF skeletons, 1/0.45
inch = 56.444 mm; others write inches, centimetres, decimetres (MakeHuman) or metres. Without a scale the unit is taken that
brings the height of the skeleton at rest closest to 1.65 m, by ratio: right for adults, whose joints span 1.3 to 2 m.
"""

from __future__ import annotations

import math
from os import PathLike
from typing import Any

import numpy as np

from poseppl.errors import InputError, PosepplError
from poseppl.io.files import read_text
from poseppl.io.motion import Motion, to_z_up
from poseppl.io.number import parse_number, parse_numbers

UNITS_MM = (1.0, 10.0, 25.4, 25.4 / 0.45, 100.0, 1000.0)
TYPICAL_HEIGHT_MM = 1650.0
MAX_JOINTS = 500
MAX_POINTS = 20_000_000
_Line = tuple[int, list[str]]


def read_bvh(path: str | PathLike[str], *, scale: float | None = None, up: str | None = None) -> Motion:
    """Read a BVH recording.

    Args:
        path: The .bvh file; each joint with three rotation channels, the root with three position channels besides.
        scale: Millimetres in one unit of length; guessed by default (see the module), and then named in ``source``.
        up: The axis that points up, "x", "y" or "z"; inferred by pybvh from the first frame by default.

    Returns:
        The motion, Z up, in mm: joints and end sites ("NAME_end"). ``angles`` holds the rotation channels of each joint in the
        file's order, in radians.

    Raises:
        InputError: The file is malformed, holds a value that is not finite, or has no height to guess the scale from.
        PosepplError: pybvh is not installed.
    """
    if scale is not None and not 1e-6 <= scale <= 1e6:
        raise InputError(f"{scale:g} mm a unit", field="scale", expected="a positive number")
    _check_text(path, read_text(path))
    pybvh = _library()
    try:
        with np.errstate(all="ignore"):
            clip = pybvh.read_bvh_file(str(path), world_up=f"+{up}" if up else "auto", warn_on_world_up_disagreement=False)
            points = np.asarray(clip.node_positions(), dtype=np.float64)
            rest = np.asarray(clip.rest_pose_positions(), dtype=np.float64)
            world_up = str(clip.world_up)
    except Exception as error:
        raise InputError(f"pybvh refuses it: {error}", file=path) from error
    if world_up not in ("+x", "+y", "+z"):
        raise InputError(f"the up axis seems to be {world_up}", file=path, field="up", expected="x, y or z, given explicitly")
    height = float(np.ptp(rest[:, "xyz".index(world_up[1])]))
    source = str(path)
    if scale is None:
        scale = _guess_scale(path, height)
        source = f"{path} (1 unit taken as {scale:.4g} mm)"
    if not np.all(np.isfinite(points)):
        raise InputError("positions are not finite", file=path)
    names, parents = _names(clip.nodes)
    angles = {name: np.asarray(clip.joint_angles[:, i]) for i, name in enumerate(clip.joint_names)}
    return to_z_up(Motion(names, points * scale, parents, angles, float(clip.fps), world_up[1], source))


def _library() -> Any:
    try:
        import pybvh
    except ImportError as error:
        raise PosepplError("reading .bvh files needs pybvh: pip install 'poseppl[mocap]'") from error
    return pybvh


def _guess_scale(path: str | PathLike[str], height: float) -> float:
    if not height > 1e-6:
        raise InputError("the skeleton has no height to guess its unit from", file=path, field="scale", expected="mm a unit")
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


def _check_text(path: str | PathLike[str], text: str) -> None:
    lines = [(line, words) for line, raw in enumerate(text.split("\n"), start=1) if (words := raw.split())]
    motion = next((i for i, (_, words) in enumerate(lines) if words[0] == "MOTION"), None)
    if lines[:1] == [] or lines[0][1][0] != "HIERARCHY":
        raise InputError("no HIERARCHY", file=path, line=1, expected="a BioVision recording (.bvh)")
    if motion is None:
        raise InputError("no MOTION section; is the file truncated?", file=path, line=lines[-1][0])
    channels, points = _check_hierarchy(path, lines[1:motion])
    _check_motion(path, lines[motion:], channels, points)


def _check_hierarchy(path: str | PathLike[str], lines: list[_Line]) -> tuple[int, int]:
    names: set[str] = set()
    channels = depth = points = 0
    for line, words in lines:
        key, rest = words[0], words[1:]
        if key in ("ROOT", "JOINT"):
            if len(rest) != 1 or rest[0] in names:
                raise InputError("a joint without one name of its own", file=path, line=line, field=key, expected="NAME")
            names.add(rest[0])
            points += 1
        elif key == "End":
            points += 1
        elif key == "OFFSET":
            if len(rest) != 3:
                raise InputError(f"{len(rest)} values", file=path, line=line, field="OFFSET", expected="3 numbers")
            parse_numbers(rest, file=path, line=line, field="OFFSET")
        elif key == "CHANNELS":
            if not rest or rest[0] != str(len(rest) - 1):
                raise InputError("the count differs from the list", file=path, line=line, field="CHANNELS")
            channels += len(rest) - 1
        elif words in (["{"], ["}"]):
            depth += 1 if key == "{" else -1
        else:
            raise InputError(f"{key[:40]!r} is no part of a hierarchy", file=path, line=line)
        if depth < 0 or points > MAX_JOINTS:
            problem = "a } too many" if depth < 0 else f"more than {MAX_JOINTS} joints"
            raise InputError(problem, file=path, line=line)
    if depth or not points:
        raise InputError("the hierarchy is not closed" if depth else "the hierarchy is empty", file=path)
    return channels, points


def _check_motion(path: str | PathLike[str], lines: list[_Line], channels: int, points: int) -> None:
    heads = [words[: len(key)] for (_, words), key in zip(lines[1:3], (["Frames:"], ["Frame", "Time:"]), strict=False)]
    if heads != [["Frames:"], ["Frame", "Time:"]]:
        raise InputError("no lines Frames: and Frame Time: after MOTION", file=path, line=lines[0][0])
    (line, frames), (time_line, time) = lines[1:3]
    if len(frames) != 2 or not frames[1].isascii() or not frames[1].isdigit() or len(frames[1]) > 9:
        raise InputError("no number of frames", file=path, line=line, field="Frames:", expected="a whole number")
    seconds = parse_number(" ".join(time[2:]), file=path, line=time_line, field="Frame Time:")
    if not 1e-5 <= seconds <= 100.0:
        raise InputError(f"{seconds:g} s", file=path, line=time_line, field="Frame Time:", expected="a positive time in s")
    rows = lines[3:]
    if len(rows) != int(frames[1]) or not rows:
        raise InputError(f"{len(rows)} frames", file=path, line=lines[-1][0], expected=f"{frames[1]}, as Frames: says")
    if len(rows) * points > MAX_POINTS:
        raise InputError(f"{len(rows)} frames of {points} joints", file=path, expected=f"at most {MAX_POINTS} positions")
    for line, words in rows:
        if len(words) != channels:
            raise InputError(f"{len(words)} values", file=path, line=line, expected=f"{channels}, one a channel")
        parse_numbers(words, file=path, line=line)
