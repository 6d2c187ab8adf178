"""Files that somebody damaged."""

from __future__ import annotations

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
