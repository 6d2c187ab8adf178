"""Sizes of a standing adult from the stature alone, and how people differ: mean and covariance of the anthropometric prior.

Lengths of segments and heights of joints are the shares of stature of Drillis and Contini (1966, *Body Segment Parameters*,
TR-1166-03), as in Winter, *Biomechanics and Motor Control of Human Movement* (2009, doi:10.1002/9780470549148, Fig. 4.1).
Heights: shoulder 0.818, hip 0.530, knee 0.285, ankle 0.039. Lengths: upper arm 0.186, forearm 0.146, hand 0.108, foot 0.152.
Breadth of the shoulders: 0.259. The values were compared with several reproductions of that figure, not with the report. The
figure gives no thicknesses, and its breadth of the hips, 0.191, is that of the body. The distance of the centres of the hips
(0.05 from the midline; H-Anim 1.1 has 0.055) and all thicknesses are our choice, near the half-breadths and girths of adults in
thin clothes.

>>> round(segment_lengths(1750.0)["thigh"], 1)
428.8

Sminchisescu and Triggs (2001, section 3.2) take a Gaussian prior N(mu_a, Sigma_a) over a body's proportions, whose mean is the
standard humanoid of H-Anim 1.1 (appendix A: default joint centres, of a person of 1.7504 m). So does this; the left side is
mirrored. H-Anim gives no hands and feet in one piece: these are the shares of Drillis and Contini.

Sigma_a is not in the paper. In the survey of the U.S. Army (Gordon et al. 2014, *2012 Anthropometric Survey of U.S. Army
Personnel*, NATICK/TR-15/007; 4082 men) standard deviations are, in per cent of the means: stature 3.9, acromion to radiale 5.2,
radiale to stylion 5.7, biacromial breadth 4.6, trochanterion height 5.5, lateral epicondyle's height 5.4. Here all sizes share
a factor with standard deviation 3.9 %, the stature's, and each has one of 3.5 % of its own, 5.2 % together; offsets that are
near 0 in the standard have 10 mm; widths of the flesh, for which we have no survey, have 10 %.

>>> sizes = humanoid_sizes(1750.0)
>>> round(sizes["thigh"]), round(sizes["upper_arm"]), round(sizes["hip_side"])
(427, 303, 96)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from poseppl.arrays import Floats

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


H_ANIM_STATURE = 1.7504
H_ANIM_CENTRES: Mapping[str, tuple[float, float, float]] = {
    "sacroiliac": (0.0, 0.9149, 0.0016),
    "hip": (0.0961, 0.9124, -0.0001),
    "knee": (0.1040, 0.4867, 0.0308),
    "ankle": (0.1101, 0.0656, -0.0736),
    "sternoclavicular": (0.0820, 1.4488, -0.0353),
    "shoulder": (0.2029, 1.4376, -0.0387),
    "elbow": (0.2014, 1.1357, -0.0682),
    "wrist": (0.1984, 0.8663, -0.0583),
    "skullbase": (0.0044, 1.6209, 0.0236),
    "skull_tip": (0.0050, 1.7504, 0.0055),
}
"""Centres of H-Anim's default joints of the left side, and its site on top of the skull: metres to the left, up, forward."""
WAIST_SHARE = 0.25
"""Height of the joint between pelvis and thorax as a share of the way from the hips to the clavicles; ours."""

COMMON_DEVIATION, OWN_DEVIATION, WIDTH_DEVIATION = 0.039, 0.035, 0.10
"""Relative standard deviations: of the factor of all sizes, of each length, of each width."""
OFFSET_DEVIATION = 10.0
"""Standard deviation (mm) of offsets forward and up."""
OFFSETS = ("hip_forward", "hip_drop", "clavicle_forward", "clavicle_up", "skull_forward", "shoulder_drop")
INTERNAL = ("hip_side", "hip_forward", "hip_drop", "clavicle_side", "clavicle_forward", "clavicle_up", "skull_forward", "head")
"""The eight internal proportions of section 2, "positions of the hip, clavicle and skull tip joints": sideways, forward and up
or down for hips and clavicles, forward and up for the tip of the skull. The paper does not list them."""
LIMBS = ("upper_arm", "forearm", "thigh", "shank")


def _lengths() -> dict[str, float]:
    """Shares of stature."""
    at = {name: np.array(centre) / H_ANIM_STATURE for name, centre in H_ANIM_CENTRES.items()}

    def apart(first: str, second: str) -> float:
        return float(np.linalg.norm(at[first] - at[second]))

    trunk = at["sternoclavicular"][1] - at["sacroiliac"][1]
    return {
        "waist": WAIST_SHARE * trunk,
        "thorax": (1 - WAIST_SHARE) * trunk,
        "neck": at["skullbase"][1] - at["sternoclavicular"][1],
        "head": at["skull_tip"][1] - at["skullbase"][1],
        "skull_forward": 0.0,
        "clavicle_side": at["sternoclavicular"][0],
        "clavicle_forward": 0.0,
        "clavicle_up": 0.0,
        "shoulder_side": at["shoulder"][0] - at["sternoclavicular"][0],
        "shoulder_drop": at["sternoclavicular"][1] - at["shoulder"][1],
        "upper_arm": apart("shoulder", "elbow"),
        "forearm": apart("elbow", "wrist"),
        "hand": LENGTH_SHARES["hand"],
        "hip_side": at["hip"][0],
        "hip_forward": 0.0,
        "hip_drop": at["sacroiliac"][1] - at["hip"][1],
        "thigh": apart("hip", "knee"),
        "shank": apart("knee", "ankle"),
        "ankle_height": at["ankle"][1],
        "foot": LENGTH_SHARES["foot"],
    }


def _widths() -> dict[str, float]:
    """Half-widths in the middle of parts, as shares of stature."""
    middles = {f"{name}_width": sum(pair) / 2 for name, pair in RADIUS_SHARES.items()}
    torso = middles.pop("torso_width")
    return {"chest_width": torso, "chest_depth": TORSO_DEPTH * torso, "pelvis_width": torso} | middles


LENGTHS, WIDTHS = tuple(_lengths()), tuple(_widths())


def humanoid_sizes(stature: float = STATURE) -> dict[str, float]:
    """Lengths and half-widths (mm) of the standard humanoid at a stature (mm)."""
    return {name: share * stature for name, share in (_lengths() | _widths()).items()}


def anthropometric_prior(names: Sequence[str]) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of sizes, mm; the stature's standard deviation is part of the covariance.

    Args:
        names: Names of :func:`humanoid_sizes`.

    Raises:
        ValueError: A name that is none of them.
    """
    sizes = humanoid_sizes()
    unknown = [name for name in names if name not in sizes]
    if unknown:
        raise ValueError(f"no size {unknown[0]!r}; expected names of {sorted(sizes)}")
    mean = np.array([sizes[name] for name in names])
    own = np.array([WIDTH_DEVIATION if name in WIDTHS else OWN_DEVIATION for name in names]) * mean
    own = np.where([name in OFFSETS for name in names], OFFSET_DEVIATION, own)
    return mean, np.diag(own**2) + COMMON_DEVIATION**2 * np.outer(mean, mean)
