"""The trackers of section 5: how each sees, which constraints it has, and how it searches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

FULL_MODES, FULL_DIRECTIONS = 7, 6
ARM_MODES, ARM_DIRECTIONS = 3, 3
_HYPOTHESES = 10


class Tracker(NamedTuple):
    """A tracker.

    Attributes:
        robust: Whether errors are Lorentzian; otherwise Gaussian.
        limits: Whether joints have limits: bounds of the search, or of ours a smooth barrier.
        parts: Whether parts are kept out of each other; None for those of the arm alone, for on a body it takes most
            of the time.
        modes: Modes that are kept, in units of the paper's for this body; 0 for a single one, which is not sampled about.
        hypotheses: Whether it is that of Cham and Rehg (1999): 10 modes, sampled by their covariance and the dynamical noise.
        draws: Whether it is ours, the assumed density filter at its defaults, whose answer is the mean of draws.
    """

    robust: bool = True
    limits: bool = True
    parts: bool | None = None
    modes: int = 1
    hypotheses: bool = False
    draws: bool = False


TRACKERS: Mapping[str, Tracker] = {
    "Gaussian, single mode": Tracker(robust=False, modes=0),
    "robust, single mode": Tracker(modes=0),
    "MHT, Gaussian, unconstrained": Tracker(robust=False, limits=False, hypotheses=True),
    "MHT, robust": Tracker(hypotheses=True),
    "without joint limits": Tracker(limits=False),
    "with non-penetration": Tracker(parts=True),
    "without non-penetration": Tracker(parts=False),
    "covariance scaled": Tracker(),
    "covariance scaled, twice as many": Tracker(modes=2),
    "assumed density": Tracker(limits=False, draws=True),
    "assumed density, joint limits": Tracker(draws=True),
}
PUBLISHED = "covariance scaled"
OURS = "assumed density"
OURS_LIMITED = "assumed density, joint limits"


def search_settings(tracker: Tracker, kind: str) -> dict[str, Any]:
    """Arguments of the filter: starts are the modes, and four for each direction."""
    modes, directions = (ARM_MODES, ARM_DIRECTIONS) if kind == "arm" else (FULL_MODES, FULL_DIRECTIONS)
    starts = modes + 4 * directions
    if tracker.hypotheses:
        return {"num_modes": _HYPOTHESES, "num_starts": max(starts, 2 * _HYPOTHESES), "sampling": "hypotheses", "stretch": 1.0}
    if not tracker.modes:
        return {"num_modes": 1, "num_starts": 1}
    times = tracker.modes
    return {"num_modes": times * modes, "num_starts": times * starts, "num_directions": times * directions, "stretch": 10.0}
