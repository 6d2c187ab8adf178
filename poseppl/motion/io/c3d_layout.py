"""Layout and numbers of a C3D file: header and parameters, where its data are, and what processor wrote them.

A C3D file has a header block, a parameter section and a data section, tied together by block numbers and byte counts that a
damaged file gets wrong. Everything that a reader would follow is checked against the size of the file here. Numbers are those
of Intel, DEC (VAX: halves exchanged, and an exponent that is greater by 2) and MIPS (big-endian).

Source: The C3D File Format, Motion Lab Systems, https://www.c3d.org.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_bytes

BLOCK = 512
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

    def __init__(self, at: Location, processor: int, found: dict[str, Parameter]) -> None:
        self._at, self._processor, self._found = at, processor, found

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def integer(self, name: str, words: int = 1) -> int:
        """The integer of so many words of 16 bits, the lowest first, of a parameter that must be there."""
        parameter = self._found.get(name)
        if parameter is None or parameter.kind != 2 or len(parameter.data) < 2 * words:
            problem = "the parameter is missing" if parameter is None else "not an integer"
            raise self._at.in_field(name).error(problem, f"a {16 * words}-bit integer")
        stored = whole_numbers(parameter.data, self._processor)[:words]
        return sum(int(word) << (16 * number) for number, word in enumerate(stored))

    def number(self, name: str) -> float:
        """The finite number of a parameter that must be there, of floating point or an integer."""
        parameter = self._found.get(name)
        if parameter is not None and parameter.kind == 2:
            return float(self.integer(name))
        values: Any = [] if parameter is None or parameter.kind != 4 else real_numbers(parameter.data, self._processor)
        if not len(values) or not math.isfinite(values[0]):
            problem = "the parameter is missing" if parameter is None else "not a finite number"
            raise self._at.in_field(name).error(problem, "a number")
        return float(values[0])

    def texts(self, name: str) -> list[str]:
        """The texts of a parameter; none where there is none, or it has numbers."""
        parameter = self._found.get(name)
        if parameter is None or parameter.kind != -1:
            return []
        width = parameter.dimensions[0] if parameter.dimensions else 1
        parts = [parameter.data[start : start + width] for start in range(0, len(parameter.data), width or 1)]
        words = [part.decode("utf-8", "surrogateescape").encode("utf-8", "replace").decode() for part in parts]
        return [word.replace("\0", "").strip() for word in words]


class Layout(NamedTuple):
    """Layout that the header and the parameters tell.

    Attributes:
        points: Points in a frame.
        analogs: Other numbers in a frame, after its points.
        frames: Frames.
        rate: Frames a second.
        scale: Units of length in a whole number; negative where numbers are of floating point.
        parameters: The parameters.
        processor: Which one wrote it.
        stored: Bytes of the frames.
    """

    points: int
    analogs: int
    frames: int
    rate: float
    scale: float
    parameters: Parameters
    processor: int
    stored: bytes


def read_layout(path: FilePath) -> Layout:
    """Read a C3D file, and check that its parts are where it says and fit into it.

    Args:
        path: The .c3d file, of Intel, DEC or MIPS byte order.

    Returns:
        Its content.

    Raises:
        InputError: The file is no C3D, is truncated, contradicts itself or uses a part of the format that is not supported.
    """
    data, at = read_bytes(path, max_bytes=MAX_BYTES), Location(path)
    if len(data) < 2 * BLOCK or data[1] != 0x50:
        raise at.error("the first block is no C3D header", "a C3D file")
    start = (data[0] - 1) * BLOCK
    if start < BLOCK or start + 4 > len(data):
        raise at.in_field("header").error(f"parameters in block {data[0]}", "a block of the file")
    blocks, processor = data[start + 2 : start + 4]
    if processor not in PROCESSORS:
        raise at.in_field("processor").error(f"byte order {processor}", "84 (Intel), 85 (DEC) or 86 (MIPS)")
    end = start + blocks * BLOCK
    if blocks == 0 or end > len(data):
        raise at.in_field("parameters").error(f"{blocks} parameter blocks", "as many as the file has")
    parameters = _parameters(at, data[start + 4 : end], processor)
    words = tuple(map(int, whole_numbers(data[:20], processor)))
    points = parameters.integer("POINT:USED")
    if not 1 <= points <= MAX_POINTS:
        raise at.in_field("POINT:USED").error(f"{points} points", f"1 to {MAX_POINTS}")
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
    stored = _stored(at, words, parameters, data, frames, 4 if scale < 0 else 2)
    return Layout(points, words[2], frames, rate, scale, parameters, processor, stored)


def _parameters(at: Location, section: bytes, processor: int) -> Parameters:
    groups: dict[int, str] = {}
    found: dict[tuple[int, str], Parameter] = {}
    cursor = 0
    while cursor + 2 <= len(section):
        length, group = struct.unpack_from("bb", section, cursor)
        if length == 0 or group == 0:
            break
        name_end = cursor + 2 + abs(length)
        if name_end + 2 > len(section):
            raise at.in_field("parameters").error("a parameter runs over its section")
        name = section[cursor + 2 : name_end].decode("latin-1").strip().upper()
        offset = int(whole_numbers(section[name_end : name_end + 2], processor)[0])
        following = name_end + offset if offset else len(section)
        if following > len(section) or (offset and following < name_end + 3):
            raise at.in_field(name).error(f"the parameter ends outside its section of {len(section) // BLOCK + 1} blocks")
        body = section[name_end + 2 : following]
        if group < 0:
            if -group in groups or name in groups.values():
                raise at.in_field(name).error("the group is repeated")
            groups[-group] = name
        elif (group, name) in found:
            raise at.in_field(name).error("the parameter is repeated")
        else:
            found[group, name] = _parameter(at.in_field(name), body)
        cursor = following
    for group, name in found:
        if group not in groups:
            raise at.in_field(name).error(f"group {group} of the parameter does not exist")
    return Parameters(at, processor, {f"{groups[group]}:{name}": value for (group, name), value in found.items()})


def _parameter(at: Location, body: bytes) -> Parameter:
    if len(body) < 2:
        raise at.error("the parameter is cut off")
    kind, count = struct.unpack_from("bB", body)
    if kind not in _SIZES or count > 7:
        raise at.error(f"type {kind} with {count} dimensions", "type -1, 1, 2 or 4")
    start = 2 + count
    dimensions = tuple(body[2:start])
    end = start + math.prod(dimensions) * _SIZES[kind]
    if len(dimensions) < count or end > len(body):
        raise at.error("its dimensions exceed the parameter")
    return Parameter(kind, dimensions, body[start:end])


def _frames(at: Location, words: tuple[int, ...], parameters: Parameters) -> int:
    frames = words[4] - words[3] + 1
    if words[3] == 0 or frames < 1:
        raise at.in_field("header").error(f"frames {words[3]} to {words[4]}", "1 or more, ascending")
    ends = [f"TRIAL:ACTUAL_{end}_FIELD" for end in ("START", "END")]
    if all(end in parameters for end in ends):
        first, last = (parameters.integer(end, words=2) for end in ends)
        actual = last - first + 1
        if actual < 1 or (actual != frames and words[4] != 65535):
            raise at.in_field("header").error(f"the header has {frames} frames, TRIAL {actual}")
        frames = actual
    return frames


def _stored(at: Location, words: tuple[int, ...], parameters: Parameters, data: bytes, frames: int, width: int) -> bytes:
    """The bytes of all frames."""
    block = parameters.integer("POINT:DATA_START")
    start = (block - 1) * BLOCK
    if block == 0 or start >= len(data):
        raise at.in_field("POINT:DATA_START").error(f"data in block {block}", "a block of the file")
    if words[8] != block:
        raise at.in_field("header").error(f"the header has data in block {words[8]}", f"{block}")
    analogs, samples = words[2], words[9]
    if analogs and (samples == 0 or analogs % samples):
        raise at.in_field("header").error(f"{analogs} analog values in {samples} samples")
    channels = analogs // samples if analogs else 0
    used = parameters.integer("ANALOG:USED") if "ANALOG:USED" in parameters else 0
    if channels and used != channels:
        raise at.in_field("header").error(f"the header has {channels} channels, ANALOG:USED {used}")
    values = frames * (4 * words[1] + analogs)
    if start + values * width > len(data):
        problem = f"{frames} frames of {words[1]} points do not fit into the file; is it truncated?"
        raise at.in_field("data").error(problem, f"{values * width} bytes of data")
    if values > MAX_VALUES:
        raise at.in_field("data").error(f"{values} values", f"at most {MAX_VALUES}")
    return data[start : start + values * width]


PROCESSORS = INTEL, DEC, MIPS = 84, 85, 86
_EXPONENT = 0x7F800000


def whole_numbers(data: bytes, processor: int) -> NDArray[Any]:
    """Whole numbers of 16 bits, without sign."""
    return np.frombuffer(data, ">u2" if processor == MIPS else "<u2").astype(np.uint16)


def real_numbers(data: bytes, processor: int) -> NDArray[Any]:
    """Floating-point numbers of 32 bits."""
    if processor != DEC:
        return np.frombuffer(data, ">f4" if processor == MIPS else "<f4").astype(np.float32)
    halves = np.frombuffer(data, "<u4")
    number = (halves >> np.uint32(16)) | (halves << np.uint32(16))
    ordinary = (number & np.uint32(_EXPONENT)) > np.uint32(2 << 23)  # what is smaller is 0 to a float of 32 bits
    return np.where(ordinary, number - np.uint32(2 << 23) * ordinary.astype(np.uint32), 0).astype(np.uint32).view(np.float32)
