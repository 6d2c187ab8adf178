"""A verdict, its severity, and the words that all verdicts share.

>>> frame_ranges([14, 15, 16, 17, 20])
'frames 14-17, 20'
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Floats, Integers
from poseppl.diagnostics.selection import told
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import provenance

ERROR, WARNING, INFO = "error", "warning", "info"
SEVERITIES = (ERROR, WARNING, INFO)

NOT_RUN = "not run"
ESS_LOW = 10.0
MAX_RANGES = 6
"""Ranges of frames that are spelt out."""
_OTHER_PRIOR = "learn the prior from more people (poseppl fit-motion), track without --prior"


class Verdict(NamedTuple):
    """One finding: its ``severity`` ("error", "warning" or "info") and the sentence."""

    severity: str
    text: str


Findings = Iterator[Verdict]
"""What a check yields."""


def not_run(reason: str = "") -> Verdict:
    """What a check yields that cannot judge a result; without a reason where it is for results of another kind.

    Args:
        reason: What is missing, in a few words.
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


def of_walk(tree: xr.DataTree, advice: str) -> str:
    """Advice on the random walk's options, or what stands in its place where none of them is taken."""
    if array_of(tree, "inputs", "posture_mean") is not None:
        return "use --walk learned or fixed"
    return _OTHER_PRIOR if provenance(tree).get("prior") else advice


def in_one_camera(tree: xr.DataTree) -> bool:
    """Whether these are keypoints in one camera: errors that last count as noise, which is wider than frames differ by."""
    return "layout" in provenance(tree) and len(names_of(tree, "camera")) == 1


def array_of(tree: xr.DataTree, group: str, name: str) -> Floats | None:
    """A variable of a group; None where the result has none of this name."""
    values = variable(tree, group, name)
    return None if values is None else np.asarray(values, np.float64)


def statistic(tree: xr.DataTree, name: str) -> Floats | None:
    """One of the sample statistics (frame,); None where the result has none of this name."""
    return array_of(tree, "sample_stats", name)


def settings_among(tree: xr.DataTree, *names: str) -> str:
    """Those of some settings that the run's algorithm has, as its command takes them; all of them where it does not tell."""
    settings = told(tree, "smoother settings" if "smoother" in provenance(tree) else "settings")
    there = [f"--set {name}" for name in names if name in settings]
    *others, last = there or names
    return f"{', '.join(others)} or {last}" if others else last
