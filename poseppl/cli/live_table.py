"""The table of `poseppl track live`, which another program can follow: a line a frame, written at once."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from poseppl.files.csv_texts import shielded


class LiveTable:
    """A table to which a line is added for each frame, at once.

    Args:
        path: The file.
        rate: Frames a second.
        note: Receives a message if a line cannot be written.

    Attributes:
        latencies: Seconds from when a frame's files were there to its line.
    """

    def __init__(self, path: Path, rate: float, note: Callable[[str], None]) -> None:
        self._path, self._rate, self._note = path, rate, note
        self._stream: TextIO | None = None
        self.latencies: list[float] = []
        path.unlink(missing_ok=True)

    def begin(self, markers: Sequence[str]) -> None:
        """Write the head."""
        try:
            self._stream = self._path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            self._tell(error)
        places = [f"{marker}_{axis}{end}" for marker in markers for axis in "xyz" for end in ("", "_lower", "_upper")]
        self._add(["frame", "time", "latency_ms", *places])

    def write(self, estimate: Any, since: Sequence[float]) -> None:
        """Write the lines of frames, whose files were there at some times."""
        for t, (frame, came) in enumerate(zip(estimate.frames, since, strict=True)):
            ends = (estimate.mean[t], estimate.lower[t], estimate.upper[t])
            places = [f"{end[k, axis]:.2f}" for k in range(len(ends[0])) for axis in range(3) for end in ends]
            self.latencies.append(time.monotonic() - came)
            self._add([str(frame), f"{frame / self._rate:.6f}", f"{1e3 * self.latencies[-1]:.1f}", *places])

    def _add(self, fields: Sequence[str]) -> None:
        try:
            if self._stream is not None:
                csv.writer(self._stream, lineterminator="\n").writerow(map(shielded, fields))
        except OSError as error:
            self._tell(error)
            self.close()

    def _tell(self, error: OSError) -> None:
        self._note(f"{self._path}: no more lines, but the run continues: {error.strerror}")

    def close(self) -> None:
        """No more lines."""
        with suppress(OSError):  # a full disk was reported
            if self._stream is not None:
                self._stream.close()
        self._stream = None

    def latency(self, first: int) -> str:
        """How long frames took, but for the first ones: a sentence."""
        import numpy as np

        seconds = self.latencies[first:]
        if not seconds:
            return "all frames were among the first ones"
        middle, most = 1e3 * np.quantile(seconds, [0.5, 0.95])
        return (
            f"{len(seconds)} frames after the first ones: from a frame's last file to its line {middle:.0f} ms in the median, "
            f"{most:.0f} ms at the 95th percentile; a frame lasts {1e3 / self._rate:.0f} ms"
        )
