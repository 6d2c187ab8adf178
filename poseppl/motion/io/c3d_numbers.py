"""Numbers of C3D files as their processors write them: Intel, DEC (VAX floating point) and MIPS (big-endian).

A VAX number has its two halves exchanged and an exponent that is greater by 2.

Source: The C3D File Format, Motion Lab Systems, https://www.c3d.org.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

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
