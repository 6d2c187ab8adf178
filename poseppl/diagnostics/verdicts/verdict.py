"""A verdict, its severity, its remedies, and the words that all verdicts share.

>>> print(Verdict(WARNING, "The steps are too large;", (Remedy("lower {}", "step_size"), Remedy("use {}", "filter", "kalman"))))
warning: The steps are too large; lower step_size, or use filter='kalman'.

>>> frame_ranges([14, 15, 16, 17, 20])
'frames 14-17, 20'
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Floats, Integers
from poseppl.diagnostics.selection import provenance_table
from poseppl.errors import Argument, Wording
from poseppl.runs.contents import variable
from poseppl.runs.results import provenance

ERROR, WARNING, INFO = "error", "warning", "info"
SEVERITIES = (ERROR, WARNING, INFO)

NOT_RUN = "not run"
MAX_RANGES = 6
"""Ranges of frames that are spelt out."""


class Remedy(NamedTuple):
    """A remedy for a finding.

    Attributes:
        words: A phrase, with "{}" where the argument is named.
        argument: The argument to change, as Python has it; empty where there is none.
        value: The value to give it; None where the phrase says how to change it.
        setting: Whether it is one of the filter or the smoother.
    """

    words: str
    argument: str = ""
    value: str | None = None
    setting: bool = False

    @property
    def named(self) -> Argument:
        """The argument, as messages name it."""
        return Argument(self.argument, self.value, self.setting)


class Verdict(NamedTuple):
    """One finding.

    Attributes:
        severity: "error", "warning" or "info".
        finding: The finding: a sentence, or the start of one that its remedies complete.
        remedies: Its remedies.
    """

    severity: str
    finding: str
    remedies: tuple[Remedy, ...] = ()

    @property
    def text(self) -> str:
        """Finding and remedies, arguments as Python has them."""
        return self.worded(str)

    def worded(self, name: Wording) -> str:
        """Finding and remedies, arguments by the name that a function gives them."""
        alike = groupby(self.remedies, lambda remedy: remedy.words)
        ways = [words.format(_either([name(remedy.named) for remedy in remedies], " or ")) for words, remedies in alike]
        return f"{self.finding} {_either(ways, ', or ')}." if ways else self.finding

    def __str__(self) -> str:
        return f"{self.severity}: {self.text}"


Findings = Iterator[Verdict]
"""The output of a check."""


def _either(names: Sequence[str], last: str) -> str:
    return last.join([", ".join(names[:-1]), names[-1]]) if names[1:] else "".join(names)


def not_run(reason: str = "") -> Verdict:
    """The output of a check that cannot judge a result; without a reason where it is for results of another kind.

    Args:
        reason: The missing part, in a few words.
    """
    return Verdict(NOT_RUN, reason)


def frame_ranges(frames: Iterable[int]) -> str:
    """Name frames in words, neighbours merged.

    Args:
        frames: Frame numbers.

    Returns:
        Such as "frame 3" or "frames 3-7, 12 and 4 more".
    """
    numbers = np.unique(np.asarray(list(frames), dtype=np.int64))
    if len(numbers) == 0:
        return "no frame"
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    words = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    rest = sum(len(run) for run in runs[MAX_RANGES:])
    tail = f" and {rest} more" if rest else ""
    return f"{'frame' if len(numbers) == 1 else 'frames'} {', '.join(words[:MAX_RANGES])}{tail}"


def where(tree: xr.DataTree, mask: ArrayLike) -> str:
    """Name the frames of a mask (frame,)."""
    frames: Integers = tree["posterior"].dataset["frame"].values
    chosen = np.asarray(mask, bool)
    if chosen.all() and len(chosen) > 1:
        return "every frame"
    return frame_ranges(frames[chosen].tolist())


def array_of(tree: xr.DataTree, group: str, name: str) -> Floats | None:
    """A variable of a group; None where the result has none of this name."""
    values = variable(tree, group, name)
    return None if values is None else np.asarray(values, np.float64)


def statistic(tree: xr.DataTree, name: str) -> Floats | None:
    """One of the sample statistics (frame,); None where the result has none of this name."""
    return array_of(tree, "sample_stats", name)


def settings_among(tree: xr.DataTree, *names: str, lower: Sequence[str] = ()) -> tuple[Remedy, ...]:
    """Settings to raise, and others to lower: those that the run's algorithm has, or all if they are unknown."""
    settings = provenance_table(tree, "smoother settings" if "smoother" in provenance(tree) else "settings")
    ways = dict.fromkeys(lower, "lower") | dict.fromkeys(names, "raise")
    there = tuple(Remedy(f"{way} {{}}", name, setting=True) for name, way in ways.items() if name in settings)
    return there or tuple(Remedy(f"{way} {name}") for name, way in ways.items())
