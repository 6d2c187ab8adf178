"""Usual postures of people: mean and standard deviation of the angles of a body, radians, in recordings of them.

Those of walks, of punches and of bending over, each of which counts as much, and their mirror images; 0.05 is added to the
deviations in quadrature, for skeletons differ. ``python -m studies.postures`` prints them. There is no run, jump or
dance among the recordings. The head's turn about itself is left out: its markers do not show it.
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_models.bodies.sides import mirrored_angle

LEFT: Mapping[tuple[str, str], tuple[float, float]] = {
    ("head", "Y"): (0.0, 0.13),
    ("head", "X"): (0.16, 0.15),
    ("pelvis", "Z"): (0.0, 0.08),
    ("pelvis", "Y"): (0.0, 0.14),
    ("girdle", "Z"): (0.0, 0.08),
    ("shoulder", "Z"): (0.14, 0.40),
    ("shoulder", "Y"): (0.21, 0.29),
    ("shoulder", "X"): (0.30, 0.74),
    ("elbow", "X"): (1.00, 0.59),
    ("hip", "Z"): (0.04, 0.18),
    ("hip", "Y"): (-0.05, 0.14),
    ("hip", "X"): (0.62, 0.71),
    ("knee", "X"): (-0.72, 0.47),
}
"""Mean and standard deviation of angles of the trunk and the left side, by joint and axis."""


def _both_sides() -> dict[tuple[str, str], tuple[float, float]]:
    means = {angle: mean for angle, (mean, _) in LEFT.items()}
    return {
        (name, axis): (mirrored_angle(means, name, axis), deviation)
        for (joint, axis), (_, deviation) in LEFT.items()
        for name in ((joint,) if joint in ("head", "pelvis", "girdle") else (f"{joint}_l", f"{joint}_r"))
    }


POSTURES: Mapping[tuple[str, str], tuple[float, float]] = _both_sides()
"""Those of all joints: on the right turns about Y and Z are the other way."""

_FOOT: Mapping[tuple[str, str], tuple[float, float]] = {("ankle", "X"): (0.12, 0.20), ("ankle", "Y"): (0.0, 0.14)}
"""Ankle and subtalar angle of the left foot in two walks and squats by OpenCap and by OpenSim (as above, 0.05 in quadrature),
each side as much; the mean inversion, whose sign differs between them, is 0."""
FOOT_POSTURES: Mapping[tuple[str, str], tuple[float, float]] = {
    (f"{joint}_{side}", axis): posture for (joint, axis), posture in _FOOT.items() for side in "lr"
}
"""Those of the ankles."""
