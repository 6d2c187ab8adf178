"""When a body is lost, and what runs say of it: shares with Wilson's intervals, mean times until loss with Student's."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats

from poseppl.arrays import Floats
from poseppl_papers.measured import Interval

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


def percent_lost(lost: Floats) -> Interval:
    """Percent of the runs that lost the body, by the seconds (R,) when they did, inf for never, with Wilson's 95 % interval."""
    count, runs = int(np.isfinite(lost).sum()), len(lost)
    found: Any = stats.binomtest(count, runs).proportion_ci(method="wilson")
    return Interval(100 * count / runs, 100 * float(found.low), 100 * float(found.high))


def kept_seconds(lost: Floats, seconds: Floats | float) -> Floats:
    """How long a body was kept, s; all of the scene where it was never lost."""
    kept: Floats = np.minimum(np.asarray(lost, float), seconds)
    return kept
