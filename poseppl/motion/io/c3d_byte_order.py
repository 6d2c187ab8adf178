"""C3D files of other processors turned into Intel's byte order: DEC (VAX floating point) and MIPS (big-endian).

The header and the parameters say where whole numbers and floating-point numbers are; texts and bytes stay. A VAX number has its
two halves exchanged and an exponent that is greater by 2.

Source: The C3D File Format, Motion Lab Systems, https://www.c3d.org.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

import numpy as np

from poseppl.errors import FilePath, InputError

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
_EXPONENT = 0x7F800000
_HEADER_WORDS = ((2, 12), (16, 20), (294, 304))
"""Bytes of the header that hold whole numbers of 16 bits."""
_HEADER_FLOATS = ((12, 16), (20, 24), (304, 376))


def to_intel(path: FilePath, data: bytes) -> bytes:
    """Turn the bytes of a C3D file into Intel's order.

    Args:
        path: The file, for messages.
        data: All of it.

    Returns:
        The bytes; the same ones where they are of this order already, or no C3D at all.

    Raises:
        InputError: The processor is unknown, or the parameters are damaged.
    """
    start = (data[0] - 1) * BLOCK if data else 0
    if start < BLOCK or start + 4 > len(data):
        return data
    processor = data[start + 3]
    if processor == INTEL:
        return data
    if processor not in (DEC, MIPS):
        raise InputError(f"byte order {processor}", file=path, field="processor", expected="84 (Intel), 85 (DEC) or 86 (MIPS)")
    turned = bytearray(data)
    try:
        for first, last in _HEADER_WORDS:
            turned[first:last] = _words(data[first:last], processor)
        for first, last in _HEADER_FLOATS:
            turned[first:last] = _floats(data[first:last], processor)
        scale = _turn_parameters(turned, start, processor)
        first = (struct.unpack_from("<H", turned, 16)[0] - 1) * BLOCK
        if first < BLOCK:
            raise ValueError("the header has no data")
        whole = _floats if scale < 0 else _words
        last = first + (len(data) - first) // 4 * 4
        turned[first:last] = whole(data[first:last], processor)
    except (IndexError, ValueError, struct.error) as error:
        raise InputError(f"damaged parameters: {error}", file=path, field="parameters", expected="a whole file") from error
    turned[start + 3] = INTEL
    return bytes(turned)


class _Parameter(NamedTuple):
    """Group, name and value of POINT:SCALE's kind: the first number of a parameter of floating point."""

    group: int
    name: bytes
    value: float


def _turn_parameters(data: bytearray, start: int, processor: int) -> float:
    """Turn the parameter section in place; returns POINT:SCALE, -1 where there is none."""
    end = min(start + data[start + 2] * BLOCK, len(data))
    at, point, numbers = start + 4, 0, list[_Parameter]()
    while at + 2 <= end:
        length, group = struct.unpack_from("<bb", data, at)
        if length == 0 or group == 0:
            break
        name = bytes(data[at + 2 : at + 2 + abs(length)]).upper()
        field = at + 2 + abs(length)
        data[field : field + 2] = _words(bytes(data[field : field + 2]), processor)
        (offset,) = struct.unpack_from("<h", data, field)
        if group < 0:
            point = -group if name == b"POINT" else point
        else:
            kind, count = struct.unpack_from("<bB", data, field + 2)
            first = field + 4 + count
            last = first + math.prod(data[field + 4 : first]) * abs(kind)
            if last > end:
                raise ValueError(f"{name.decode('latin-1')[:40]} runs over its section")
            if kind in (2, 4):
                data[first:last] = (_words if kind == 2 else _floats)(bytes(data[first:last]), processor)
            if kind == 4 and last >= first + 4:
                numbers.append(_Parameter(group, name, struct.unpack_from("<f", data, first)[0]))
        if offset <= 0:
            break
        at = field + offset
    return next((number.value for number in numbers if (number.group, number.name) == (point, b"SCALE")), -1.0)


def _words(data: bytes, processor: int) -> bytes:
    return np.frombuffer(data, ">u2").astype("<u2").tobytes() if processor == MIPS else data


def _floats(data: bytes, processor: int) -> bytes:
    if processor == MIPS:
        return np.frombuffer(data, ">u4").astype("<u4").tobytes()
    halves = np.frombuffer(data, "<u4")
    number = (halves >> np.uint32(16)) | (halves << np.uint32(16))
    ordinary = (number & np.uint32(_EXPONENT)) > np.uint32(2 << 23)  # what is smaller is 0 to a float of 32 bits
    return np.where(ordinary, number - np.uint32(2 << 23) * ordinary.astype(np.uint32), 0).astype("<u4").tobytes()
