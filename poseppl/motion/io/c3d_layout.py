"""The layout of a C3D file, checked before a C++ library reads it.

A C3D file is a header of one 512-byte block, a parameter section and a data section, tied together by block numbers and byte
counts that a damaged file gets wrong. Everything that a reader would follow is checked against the size of the file here.

Source: The C3D File Format, Motion Lab Systems, https://www.c3d.org.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from poseppl.errors import FilePath, Location
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


class Parameters:
    """The parameters of a file by "GROUP:NAME", in upper case."""

    def __init__(self, at: Location, found: dict[str, Parameter]) -> None:
        self._at, self._found = at, found

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def get(self, name: str) -> Parameter | None:
        """A parameter, None where there is none of this name."""
        return self._found.get(name)

    def integer(self, name: str) -> int:
        """The 16-bit integer of a parameter that must be there."""
        parameter = self.get(name)
        if parameter is None or parameter.kind != 2 or len(parameter.data) < 2:
            problem = "the parameter is missing" if parameter is None else "not an integer"
            raise self._at.in_field(name).error(problem, "a 16-bit integer")
        return int(struct.unpack_from("<H", parameter.data)[0])

    def number(self, name: str) -> float:
        """The finite number of a parameter that must be there, of floating point or an integer."""
        parameter = self.get(name)
        if parameter is not None and parameter.kind == 4 and len(parameter.data) >= 4:
            value = float(struct.unpack_from("<f", parameter.data)[0])
            if math.isfinite(value):
                return value
        if parameter is not None and parameter.kind == 2 and len(parameter.data) >= 2:
            return float(struct.unpack_from("<H", parameter.data)[0])
        problem = "the parameter is missing" if parameter is None else "not a finite number"
        raise self._at.in_field(name).error(problem, "a number")


class Layout(NamedTuple):
    """Layout that the header and the parameters tell.

    Attributes:
        points: Points in a frame.
        frames: Frames.
        rate: Frames a second.
        turned: The whole file in Intel's byte order, where it has another; else None.
    """

    points: int
    frames: int
    rate: float
    turned: bytes | None


def check_layout(path: FilePath) -> Layout:
    """Check that the parts of a C3D file are where it says and fit into it.

    Args:
        path: The .c3d file, of Intel, DEC or MIPS byte order.

    Returns:
        What it holds.

    Raises:
        InputError: The file is no C3D, is truncated, contradicts itself or uses a part of the format that is not supported.
    """
    stored, at = check_file(path, max_bytes=MAX_BYTES).read_bytes(), Location(path)
    data = to_intel(path, stored)
    if len(data) < 2 * BLOCK or data[1] != 0x50:
        raise at.error("the first block is no C3D header", "a C3D file")
    parameters = _parameters(at, data)
    points = parameters.integer("POINT:USED")
    if not 1 <= points <= MAX_POINTS:
        raise at.in_field("POINT:USED").error(f"{points} points", f"1 to {MAX_POINTS}")
    words = struct.unpack("<10H", data[:20])
    if words[1] != points:
        raise at.in_field("header").error(f"the header has {words[1]} points, POINT:USED {points}")
    if "ROTATION:USED" in parameters and parameters.number("ROTATION:USED") != 0.0:
        raise at.in_field("ROTATION:USED").error("rotations (as of markerless systems) are not supported")
    rate, scale = parameters.number("POINT:RATE"), parameters.number("POINT:SCALE")
    if not 1e-3 <= rate <= 1e5:
        raise at.in_field("POINT:RATE").error(f"{rate:g} frames a second", "a positive rate")
    if not 0.0 < abs(scale) <= 1e6:
        raise at.in_field("POINT:SCALE").error(f"{scale:g}", "not 0")
    frames = _frames(at, words, parameters)
    _check_data(at, words, parameters, len(data), points, frames, 4 if scale < 0 else 2)
    return Layout(points, frames, rate, None if data is stored else data)


def _parameters(at: Location, data: bytes) -> Parameters:
    start = (data[0] - 1) * BLOCK
    if data[0] < 2 or start + 4 > len(data):
        raise at.in_field("header").error(f"parameters in block {data[0]}", "a block of the file")
    blocks = data[start + 2]
    end = start + blocks * BLOCK
    if blocks == 0 or end > len(data):
        raise at.in_field("parameters").error(f"{blocks} parameter blocks", "as many as the file holds")
    section = data[start + 4 : end]
    groups: dict[int, str] = {}
    found: dict[tuple[int, str], Parameter] = {}
    cursor = 0
    while cursor + 2 <= len(section):
        length, group = struct.unpack_from("<bb", section, cursor)
        if length == 0 or group == 0:
            break
        name_end = cursor + 2 + abs(length)
        if name_end + 2 > len(section):
            raise at.in_field("parameters").error("a parameter runs over its section")
        name = section[cursor + 2 : name_end].decode("latin-1").strip().upper()
        (offset,) = struct.unpack_from("<h", section, name_end)
        following = name_end + offset if offset else len(section)
        if offset < 0 or following > len(section) or (offset and following < name_end + 3):
            raise at.in_field(name).error(f"the parameter ends outside its section of {blocks} blocks")
        body = section[name_end + 2 : following]
        if group < 0:
            if -group in groups or name in groups.values():
                raise at.in_field(name).error("the group is repeated")
            if not body or 1 + body[0] > len(body):
                raise at.in_field(name).error("the description runs over the group")
            groups[-group] = name
        elif (group, name) in found:
            raise at.in_field(name).error("the parameter is repeated")
        else:
            found[group, name] = _parameter(at.in_field(name), body)
        cursor = following
        if offset == 0:
            break
    for group, name in found:
        if group not in groups:
            raise at.in_field(name).error(f"group {group} of the parameter does not exist")
    return Parameters(at, {f"{groups[group]}:{name}": parameter for (group, name), parameter in found.items()})


def _parameter(at: Location, body: bytes) -> Parameter:
    if len(body) < 2:
        raise at.error("the parameter is cut off")
    kind, count = struct.unpack_from("<bB", body)
    if kind not in _SIZES or count > 7:
        raise at.error(f"type {kind} with {count} dimensions", "type -1, 1, 2 or 4")
    dimensions = tuple(body[2 : 2 + count])
    size = math.prod(dimensions) * _SIZES[kind]
    start = 2 + count
    if len(dimensions) < count or start + size > len(body):
        raise at.error("its dimensions exceed the parameter")
    if start + size < len(body) and start + size + 1 + body[start + size] > len(body):
        raise at.error("the description runs over the parameter")
    return Parameter(kind, dimensions, body[start : start + size])


def _frames(at: Location, words: tuple[int, ...], parameters: Parameters) -> int:
    frames = words[4] - words[3] + 1
    if words[3] == 0 or frames < 1:
        raise at.in_field("header").error(f"frames {words[3]} to {words[4]}", "1 or more, ascending")
    bounds = [parameters.get(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END")]
    if all(bound is not None for bound in bounds):
        if any(bound.kind != 2 or len(bound.data) != 4 for bound in bounds if bound is not None):
            raise at.in_field("TRIAL:ACTUAL_START_FIELD").error("not two integers")
        first, last = (struct.unpack("<I", bound.data)[0] for bound in bounds if bound is not None)
        actual = last - first + 1
        if actual < 1 or (actual != frames and words[4] != 65535):
            raise at.in_field("header").error(f"the header has {frames} frames, TRIAL {actual}")
        frames = actual
    return frames


def _check_data(
    at: Location,
    words: tuple[int, ...],
    parameters: Parameters,
    size: int,
    points: int,
    frames: int,
    width: int,
) -> None:
    start = parameters.integer("POINT:DATA_START")
    if start == 0 or (start - 1) * BLOCK >= size:
        raise at.in_field("POINT:DATA_START").error(f"data in block {start}", "a block of the file")
    if words[8] != start:
        raise at.in_field("header").error(f"the header has data in block {words[8]}", f"{start}")
    analogs, samples = words[2], words[9]
    if analogs and (samples == 0 or analogs % samples):
        raise at.in_field("header").error(f"{analogs} analog values in {samples} samples")
    channels = analogs // samples if analogs else 0
    used = parameters.integer("ANALOG:USED") if "ANALOG:USED" in parameters else 0
    if channels and used != channels:
        raise at.in_field("header").error(f"the header has {channels} channels, ANALOG:USED {used}")
    values = frames * (4 * points + analogs)
    if (start - 1) * BLOCK + values * width > size:
        problem = f"{frames} frames of {points} points do not fit into the file; is it truncated?"
        raise at.in_field("data").error(problem, f"{values * width} bytes of data")
    if values > MAX_VALUES:
        raise at.in_field("data").error(f"{values} values", f"at most {MAX_VALUES}")
