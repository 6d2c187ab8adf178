"""Reading NumPy's .npy files of numbers: the header is checked before the values are read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import check_file

_MAX_HEADER = 1000


def read_array(path: FilePath, *, max_values: int) -> NDArray[Any]:
    """Read an array of floating-point numbers or integers.

    Args:
        path: The .npy file.
        max_values: The largest number of values that is read.

    Raises:
        InputError: The file is missing, damaged, too large, or has no numbers.
    """
    source, at = check_file(path, max_bytes=8 * max_values + 2**16), Location(path)
    try:
        with source.open("rb") as stream:
            version = npy.read_magic(stream)
            header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, _, kind = header(stream, max_header_size=_MAX_HEADER)
            if kind.kind not in "fiu" or math.prod(shape) > max_values:
                raise at.error(f"an array of {kind} and shape {shape}", f"at most {max_values} numbers")
            stream.seek(0)
            return np.asarray(npy.read_array(stream, allow_pickle=False, max_header_size=_MAX_HEADER))
    except (ValueError, OSError, EOFError, SyntaxError) as error:
        raise at.error(f"no NumPy array: {error}", "a whole .npy file of numbers") from error
