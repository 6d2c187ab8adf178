"""The trackers of section 5: how each sees, which constraints it has, and how it searches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

FULL_MODES, FULL_DIRECTIONS = 7, 6
ARM_MODES, ARM_DIRECTIONS = 3, 3
_HYPOTHESES = 10
LARGE = 10.0
"""Factor of the noise of rivals as published: as far as covariance scaled sampling along a direction that is as uncertain."""


class Tracker(NamedTuple):
    """A tracker.

    Attributes:
        robust: Whether errors are Lorentzian; otherwise Gaussian.
        limits: Whether joints have limits: bounds of the search, or a smooth barrier in our trackers.
        parts: Whether parts are kept out of each other; None where a scene has it so.
        modes: Modes that are kept, in units of the paper's for this body; 0 for a single one, which is not sampled about.
        hypotheses: Whether it is that of Cham and Rehg (1999): 10 modes, sampled by their covariance and the dynamical noise.
        draws: Whether it is ours, the assumed density filter at its defaults, whose answer is the mean of draws.
        noise: Factor of the dynamical noise (its covariance) by which rivals scatter.
        particles: Number of particles of CONDENSATION, which searches no modes; 0 for a tracker of modes.
        jumps: Whether every second start is a kinematic jump, a limb that leans the other way (ours; from their paper of 2003).
    """

    robust: bool = True
    limits: bool = True
    parts: bool | None = None
    modes: int = 1
    hypotheses: bool = False
    draws: bool = False
    noise: float = 1.0
    particles: int = 0
    jumps: bool = False


TRACKERS: Mapping[str, Tracker] = {
    "Gaussian, single mode": Tracker(robust=False, modes=0),
    "robust, single mode": Tracker(modes=0),
    "MHT, Gaussian, unconstrained": Tracker(robust=False, limits=False, hypotheses=True),
    "MHT, robust": Tracker(hypotheses=True),
    "MHT, Gaussian, unconstrained, large noise": Tracker(robust=False, limits=False, parts=False, hypotheses=True, noise=LARGE),
    "MHT, robust, large noise": Tracker(hypotheses=True, noise=LARGE),
    "CONDENSATION": Tracker(particles=2000),
    "CONDENSATION, large noise": Tracker(particles=2000, noise=LARGE),
    "without joint limits": Tracker(limits=False),
    "with non-penetration": Tracker(parts=True),
    "without non-penetration": Tracker(parts=False),
    "covariance scaled": Tracker(),
    "covariance scaled, kinematic jumps": Tracker(jumps=True),
    "covariance scaled, twice as many": Tracker(modes=2),
    "assumed density": Tracker(limits=False, draws=True),
    "assumed density, joint limits": Tracker(draws=True),
}
PUBLISHED = "covariance scaled"
JUMPS = "covariance scaled, kinematic jumps"
OURS = "assumed density"
OURS_LIMITED = "assumed density, joint limits"


def search_settings(tracker: Tracker, kind: str) -> dict[str, Any]:
    """Arguments of the filter: starts are the modes, and four for each direction."""
    modes, directions = (ARM_MODES, ARM_DIRECTIONS) if kind == "arm" else (FULL_MODES, FULL_DIRECTIONS)
    starts = modes + 4 * directions
    if tracker.hypotheses:
        return {
            "num_modes": _HYPOTHESES,
            "num_starts": max(starts, 2 * _HYPOTHESES),
            "sampling": "hypotheses",
            "stretch": tracker.noise,
        }
    if not tracker.modes:
        return {"num_modes": 1, "num_starts": 1}
    times = tracker.modes
    return {"num_modes": times * modes, "num_starts": times * starts, "num_directions": times * directions, "stretch": 10.0}
