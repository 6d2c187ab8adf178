"""When a body is lost, and what runs say of it: shares with Wilson's intervals, mean times until loss with Student's."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy import stats

from poseppl.arrays import Floats
from poseppl_papers.measured import Interval, mean_interval
from poseppl_papers.tables import grouped

LOST = 150.0
"""Mean distance (mm) of markers from the truth, both relative to the root, beyond which a body is lost."""
LASTING = 0.2
"""How long (s) it has to stay so."""


def lost_at(errors: Floats, rate: float) -> float:
    """Second at which a body is lost: errors (T,), mm, stay above :data:`LOST` from there for :data:`LASTING`; inf if never."""
    frames = max(1, round(LASTING * rate))
    above = np.concatenate([[0], np.cumsum(np.asarray(errors) > LOST)])
    full = np.flatnonzero(above[frames:] - above[:-frames] == frames) if len(errors) >= frames else np.array([], int)
    return float(full[0] / rate) if len(full) else float("inf")


def percent_lost(lost: Floats, motions: Iterable[str] = ()) -> Interval:
    """Percent of the runs that lost the body, with its 95 % interval.

    Args:
        lost: Seconds (R,) when they did, inf for never.
        motions: Motion of each run. The interval is Student's over motions if some have several runs, otherwise Wilson's over
            runs.
    """
    groups = grouped(zip(motions, np.isfinite(lost), strict=False), lambda pair: pair[0])
    if 1 < len(groups) < len(lost):
        return mean_interval([100 * float(np.mean([each for _, each in own])) for own in groups.values()]).clipped(0, 100)
    count, runs = int(np.isfinite(lost).sum()), len(lost)
    found: Any = stats.binomtest(count, runs).proportion_ci(method="wilson")
    return Interval(100 * count / runs, 100 * float(found.low), 100 * float(found.high))


def kept_seconds(lost: Floats, seconds: Floats | float) -> Floats:
    """How long a body was kept, s; all of the scene where it was never lost."""
    kept: Floats = np.minimum(np.asarray(lost, float), seconds)
    return kept
