"""Sizes of a standing adult from the stature alone, for bodies whose papers give none.

Lengths of segments and heights of joints are the shares of stature of Drillis and Contini (1966, *Body Segment Parameters*,
TR-1166-03), as in Winter, *Biomechanics and Motor Control of Human Movement* (2009, doi:10.1002/9780470549148, Fig. 4.1).
Heights: shoulder 0.818, hip 0.530, knee 0.285, ankle 0.039. Lengths: upper arm 0.186, forearm 0.146, hand 0.108, foot 0.152.
Breadth of the shoulders: 0.259. The values were compared with several reproductions of that figure, not with the report. The
figure gives no thicknesses, and its breadth of the hips, 0.191, is that of the body. The distance of the centres of the hips
(0.05 from the midline; H-Anim 1.1 has 0.055) and all thicknesses are our choice, near the half-breadths and girths of adults in
thin clothes.

>>> round(segment_lengths(1750.0)["thigh"], 1)
428.8
"""

from __future__ import annotations

from collections.abc import Mapping

STATURE = 1750.0
"""mm."""

LENGTH_SHARES: Mapping[str, float] = {
    "trunk": 0.288,
    "head": 0.182,
    "shoulder_width": 0.129,
    "upper_arm": 0.186,
    "forearm": 0.146,
    "hand": 0.108,
    "hip_width": 0.05,
    "thigh": 0.245,
    "shank": 0.246,
    "ankle_height": 0.039,
    "foot": 0.152,
}
"""Lengths as shares of stature; widths are from the midline, the trunk goes from the hips to the shoulders, the head
from there up."""

RADIUS_SHARES: Mapping[str, tuple[float, float]] = {
    "torso": (0.093, 0.093),
    "head": (0.04, 0.048),
    "upper_arm": (0.030, 0.025),
    "forearm": (0.025, 0.016),
    "hand": (0.020, 0.020),
    "thigh": (0.049, 0.034),
    "shank": (0.034, 0.020),
    "foot": (0.026, 0.020),
}
"""Half-thicknesses at the base and at the tip as shares of stature; the torso's is half its breadth."""

TORSO_DEPTH = 0.72
"""Depth of the torso as a share of its breadth."""


def segment_lengths(stature: float = STATURE) -> dict[str, float]:
    """Lengths (mm) of the segments of somebody so tall (mm)."""
    return {name: share * stature for name, share in LENGTH_SHARES.items()}


def segment_radii(stature: float = STATURE) -> dict[str, tuple[float, float]]:
    """Radii (mm) of the segments at the base and at the tip of somebody so tall (mm)."""
    return {name: (base * stature, tip * stature) for name, (base, tip) in RADIUS_SHARES.items()}
