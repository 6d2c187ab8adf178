"""The layout of a C3D file, checked before a C++ library reads it.

A C3D file is a header of one 512-byte block, a parameter section and a data section, tied together by block numbers and byte
counts that a damaged file gets wrong. Everything that a reader would follow is checked against the size of the file here.

Source: The C3D File Format, Motion Lab Systems, https://www.c3d.org.
"""

from __future__ import annotations

import math
import struct
from os import PathLike
from typing import NamedTuple

from poseppl.errors import InputError
from poseppl.files.bounded_reading import check_file
from poseppl.motion.io.c3d_byte_order import BLOCK, to_intel

MAX_BYTES = 256 * 2**20
MAX_VALUES = 40_000_000
MAX_POINTS = 10_000
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}


class Parameter(NamedTuple):
    """One parameter: its type (-1 text, 1 byte, 2 integer, 4 float), dimensions and raw bytes."""

    kind: int
    dimensions: tuple[int, ...]
    data: bytes


class Layout(NamedTuple):
    """Layout that the header and the parameters tell.

    Attributes:
        parameters: (group, name) in upper case to the parameter.
        points: Points in a frame.
        frames: Frames.
        rate: Frames a second.
        turned: The whole file in Intel's byte order, where it has another; else None.
    """

    parameters: dict[tuple[str, str], Parameter]
    points: int
    frames: int
    rate: float
    turned: bytes | None


def check_layout(path: str | PathLike[str]) -> Layout:
    """Check that the parts of a C3D file are where it says and fit into it.

    Args:
        path: The .c3d file, of Intel, DEC or MIPS byte order.

    Returns:
        What it holds.

    Raises:
        InputError: The file is no C3D, is truncated, contradicts itself or uses a part of the format that is not supported.
    """
    source = check_file(path, max_bytes=MAX_BYTES)
    stored = source.read_bytes()
    data = to_intel(path, stored)
    if len(data) < 2 * BLOCK or data[1] != 0x50:
        raise InputError("the first block is no C3D header", file=path, expected="a C3D file")
    parameters = _parameters(path, data)
    points = _integer(path, parameters, "POINT", "USED")
    if not 1 <= points <= MAX_POINTS:
        raise InputError(f"{points} points", file=path, field="POINT:USED", expected=f"1 to {MAX_POINTS}")
    words = struct.unpack("<10H", data[:20])
    if words[1] != points:
        raise InputError(f"the header has {words[1]} points, POINT:USED {points}", file=path, field="header")
    if _number(path, parameters, "ROTATION", "USED", 0.0) != 0.0:
        raise InputError("rotations (as of markerless systems) are not supported", file=path, field="ROTATION:USED")
    rate = _number(path, parameters, "POINT", "RATE", None)
    if not 1e-3 <= rate <= 1e5:
        raise InputError(f"{rate:g} frames a second", file=path, field="POINT:RATE", expected="a positive rate")
    scale = _number(path, parameters, "POINT", "SCALE", None)
    if not 0.0 < abs(scale) <= 1e6:
        raise InputError(f"{scale:g}", file=path, field="POINT:SCALE", expected="not 0")
    frames = _frames(path, words, parameters)
    _check_data(path, words, parameters, len(data), points, frames, 4 if scale < 0 else 2)
    return Layout(parameters, points, frames, rate, None if data is stored else data)


def _parameters(path: str | PathLike[str], data: bytes) -> dict[tuple[str, str], Parameter]:
    start = (data[0] - 1) * BLOCK
    if data[0] < 2 or start + 4 > len(data):
        raise InputError(f"parameters in block {data[0]}", file=path, field="header", expected="a block of the file")
    blocks = data[start + 2]
    end = start + blocks * BLOCK
    if blocks == 0 or end > len(data):
        raise InputError(f"{blocks} parameter blocks", file=path, field="parameters", expected="as many as the file holds")
    section = data[start + 4 : end]
    groups: dict[int, str] = {}
    found: dict[tuple[int, str], Parameter] = {}
    at = 0
    while at + 2 <= len(section):
        length, group = struct.unpack_from("<bb", section, at)
        if length == 0 or group == 0:
            break
        name_end = at + 2 + abs(length)
        if name_end + 2 > len(section):
            raise InputError("a parameter runs over its section", file=path, field="parameters")
        name = section[at + 2 : name_end].decode("latin-1").strip().upper()
        (offset,) = struct.unpack_from("<h", section, name_end)
        following = name_end + offset if offset else len(section)
        if offset < 0 or following > len(section) or (offset and following < name_end + 3):
            raise InputError(f"the parameter ends outside its section of {blocks} blocks", file=path, field=name)
        body = section[name_end + 2 : following]
        if group < 0:
            if -group in groups or name in groups.values():
                raise InputError("the group is repeated", file=path, field=name)
            if not body or 1 + body[0] > len(body):
                raise InputError("the description runs over the group", file=path, field=name)
            groups[-group] = name
        elif (group, name) in found:
            raise InputError("the parameter is repeated", file=path, field=name)
        else:
            found[group, name] = _parameter(path, name, body)
        at = following
        if offset == 0:
            break
    for group, name in found:
        if group not in groups:
            raise InputError(f"group {group} of the parameter does not exist", file=path, field=name)
    return {(groups[group], name): parameter for (group, name), parameter in found.items()}


def _parameter(path: str | PathLike[str], name: str, body: bytes) -> Parameter:
    if len(body) < 2:
        raise InputError("the parameter is cut off", file=path, field=name)
    kind, count = struct.unpack_from("<bB", body)
    if kind not in _SIZES or count > 7:
        raise InputError(f"type {kind} with {count} dimensions", file=path, field=name, expected="type -1, 1, 2 or 4")
    dimensions = tuple(body[2 : 2 + count])
    size = math.prod(dimensions) * _SIZES[kind]
    start = 2 + count
    if len(dimensions) < count or start + size > len(body):
        raise InputError("its dimensions exceed the parameter", file=path, field=name)
    if start + size < len(body) and start + size + 1 + body[start + size] > len(body):
        raise InputError("the description runs over the parameter", file=path, field=name)
    return Parameter(kind, dimensions, body[start : start + size])


def _integer(path: str | PathLike[str], parameters: dict[tuple[str, str], Parameter], group: str, name: str) -> int:
    parameter = parameters.get((group, name))
    if parameter is None or parameter.kind != 2 or len(parameter.data) < 2:
        problem = "the parameter is missing" if parameter is None else "not an integer"
        raise InputError(problem, file=path, field=f"{group}:{name}", expected="a 16-bit integer")
    return int(struct.unpack_from("<H", parameter.data)[0])


def _number(
    path: str | PathLike[str],
    parameters: dict[tuple[str, str], Parameter],
    group: str,
    name: str,
    default: float | None,
) -> float:
    parameter = parameters.get((group, name))
    if parameter is None and default is not None:
        return default
    if parameter is not None and parameter.kind == 4 and len(parameter.data) >= 4:
        value = float(struct.unpack_from("<f", parameter.data)[0])
        if math.isfinite(value):
            return value
    if parameter is not None and parameter.kind == 2 and len(parameter.data) >= 2:
        return float(struct.unpack_from("<H", parameter.data)[0])
    problem = "the parameter is missing" if parameter is None else "not a finite number"
    raise InputError(problem, file=path, field=f"{group}:{name}", expected="a number")


def _frames(path: str | PathLike[str], words: tuple[int, ...], parameters: dict[tuple[str, str], Parameter]) -> int:
    frames = words[4] - words[3] + 1
    if words[3] == 0 or frames < 1:
        raise InputError(f"frames {words[3]} to {words[4]}", file=path, field="header", expected="1 or more, ascending")
    bounds = [parameters.get(("TRIAL", f"ACTUAL_{end}_FIELD")) for end in ("START", "END")]
    if all(bound is not None for bound in bounds):
        if any(bound.kind != 2 or len(bound.data) != 4 for bound in bounds if bound is not None):
            raise InputError("not two integers", file=path, field="TRIAL:ACTUAL_START_FIELD")
        first, last = (struct.unpack("<I", bound.data)[0] for bound in bounds if bound is not None)
        actual = last - first + 1
        if actual < 1 or (actual != frames and words[4] != 65535):
            raise InputError(f"the header has {frames} frames, TRIAL {actual}", file=path, field="header")
        frames = actual
    return frames


def _check_data(
    path: str | PathLike[str],
    words: tuple[int, ...],
    parameters: dict[tuple[str, str], Parameter],
    size: int,
    points: int,
    frames: int,
    width: int,
) -> None:
    start = _integer(path, parameters, "POINT", "DATA_START")
    if start == 0 or (start - 1) * BLOCK >= size:
        raise InputError(f"data in block {start}", file=path, field="POINT:DATA_START", expected="a block of the file")
    if words[8] != start:
        raise InputError(f"the header has data in block {words[8]}", file=path, field="header", expected=f"{start}")
    analogs, samples = words[2], words[9]
    if analogs and (samples == 0 or analogs % samples):
        raise InputError(f"{analogs} analog values in {samples} samples", file=path, field="header")
    channels = analogs // samples if analogs else 0
    used = _integer(path, parameters, "ANALOG", "USED") if ("ANALOG", "USED") in parameters else 0
    if channels and used != channels:
        raise InputError(f"the header has {channels} channels, ANALOG:USED {used}", file=path, field="header")
    values = frames * (4 * points + analogs)
    if (start - 1) * BLOCK + values * width > size:
        problem = f"{frames} frames of {points} points do not fit into the file; is it truncated?"
        raise InputError(problem, file=path, field="data", expected=f"{values * width} bytes of data")
    if values > MAX_VALUES:
        raise InputError(f"{values} values", file=path, field="data", expected=f"at most {MAX_VALUES}")
