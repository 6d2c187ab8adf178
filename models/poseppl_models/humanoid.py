"""The sizes of the standard humanoid.

Sminchisescu and Triggs (2001, section 3.2) take a Gaussian prior N(mu_a, Sigma_a) over a body's proportions, whose mean is the
standard humanoid of H-Anim 1.1 (appendix A: default joint centres, of a person of 1.7504 m). So does this; the left side is
mirrored. H-Anim gives no hands and feet in one piece: these are the shares of Drillis and Contini
(:mod:`poseppl_models.anthropometry`).

>>> sizes = humanoid_sizes(1750.0)
>>> round(sizes["thigh"]), round(sizes["upper_arm"]), round(sizes["hip_side"])
(427, 303, 96)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from poseppl_models.anthropometry import LENGTH_SHARES, RADIUS_SHARES, STATURE, TORSO_DEPTH

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


LENGTHS = tuple(_lengths())


def humanoid_sizes(stature: float = STATURE) -> dict[str, float]:
    """Lengths and half-widths (mm) of the standard humanoid at a stature (mm)."""
    return {name: share * stature for name, share in (_lengths() | _widths()).items()}
