"""Files that somebody damaged."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator

import numpy as np


def damaged_copies(data: bytes, count: int) -> Iterator[bytes]:
    """Copies of a file with a few wrong bytes, or cut off, the same ones in every run."""
    rng = np.random.default_rng(7)
    for number in range(count):
        changed = np.frombuffer(data, np.uint8).copy()
        where = rng.integers(0, len(data), rng.integers(1, 40))
        changed[where] = rng.integers(0, 256, len(where))
        yield changed[: rng.integers(1, len(data)) if number % 4 == 0 else None].tobytes()


def unbalanced(data: bytes) -> bytes:
    """An .npz whose sums are right and whose headers are no Python: NumPy ends in the errors of a tokenizer."""
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(written, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b"}", b" ", 1))
    return written.getvalue()


def deflated(data: bytes) -> bytes:
    """An .npz whose parts, stored as they are, claim to be compressed."""
    changed = bytearray(data)
    for signature, offset in ((b"PK\3\4", 8), (b"PK\1\2", 10)):
        at = data.find(signature)
        while at >= 0:
            changed[at + offset] = zipfile.ZIP_DEFLATED
            at = data.find(signature, at + 4)
    return bytes(changed)
