"""A range of frames as users write it: "start:stop:step", each part optional, or one frame "n"."""

from __future__ import annotations

import re
from typing import NamedTuple

from poseppl.errors import Argument, InputError, brief


class FrameRange(NamedTuple):
    """Frames from 0: ``start``, every ``step``-th of them, up to ``stop``, which is not included; None is the last one."""

    start: int = 0
    stop: int | None = None
    step: int = 1

    @classmethod
    def parse(cls, text: str | None) -> FrameRange:
        """Read a range; None takes all frames, a single number that frame alone.

        Raises:
            InputError: It is none.
        """
        if text is None:
            return cls()
        parts = [part.strip() for part in text.split(":")]
        if len(parts) > 3 or parts == [""] or not all(re.fullmatch(r"[0-9]{0,9}", part) for part in parts):
            raise InputError(
                f"{brief(text)} is no range of frames", field=Argument("frames"), expected="start:stop:step, such as 0:100"
            )
        if len(parts) == 1:
            return cls(int(text), int(text) + 1)
        start, stop, step = (int(part) if part else None for part in [*parts, ""][:3])
        found = cls(start or 0, stop, 1 if step is None else step)
        if found.step < 1 or (found.stop is not None and found.stop <= found.start):
            raise InputError(
                f"{brief(text)} has no frame", field=Argument("frames"), expected="start:stop:step, start < stop, step >= 1"
            )
        return found

    def within(self, total: int, source: str | None = None) -> slice:
        """Return the range of a sequence.

        Args:
            total: Frames of the sequence.
            source: Its name in messages.

        Raises:
            InputError: The range goes beyond it.
        """
        stop = total if self.stop is None else self.stop
        if stop > total or self.start >= stop:
            raise InputError(
                f"'{self}' is out of range", file=source, field=Argument("frames"), expected=f"a range within 0:{total}"
            )
        return slice(self.start, stop, self.step)

    def __str__(self) -> str:
        step = f":{self.step}" if self.step > 1 else ""
        return f"{self.start}:{'' if self.stop is None else self.stop}{step}"
