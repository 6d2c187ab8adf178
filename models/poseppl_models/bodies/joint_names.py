"""Names of our markers' places in recordings, the most fitting first; and left and right: ``_l`` mirrors ``_r``.

An ASF bone stands for its far end: CMU's ``lradius`` is the upper two thirds of the forearm and ``lwrist``, which only twists
about the same line, the rest. BVH joints stand for their own place; in CMU's BVH conversions ``Spine1`` and ``Neck``
coincide, so that ``Spine`` is the middle. MakeHuman's ``__Jaw`` begins at the top of the head.

The conventions, by the left elbow: ASF ``lhumerus``; MotionBuilder, Mixamo and CMU's BVH ``LeftForeArm``; MakeHuman
``LoArm_L``; Bandai-Namco and Unreal ``LowerArm_L``; Blender ``forearm.L``; Poser and DAZ ``lForeArm``; 3ds Max
``Bip01_L_Forearm``; SMPL and DeepMimic ``left_elbow``. Names are compared without case, punctuation and namespace if none fits
exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

_SKIN = {
    "pelvis": ("LASI+RASI+LPSI+RPSI", "LFWT+RFWT+LBWT+RBWT", "L.ASIS+R.ASIS+L.PSIS+R.PSIS", "LHip+RHip"),
    "chest": ("T10+STRN",),
    "neck": ("C7+CLAV", "C7+L_Sternum+R_Sternum", "R.Clavicle+L.Clavicle"),
    "skull": ("C7+CLAV+LFHD+RFHD+LBHD+RBHD",),
    "crown": ("LFHD+RFHD+LBHD+RBHD",),
}
"""Skin markers whose mean lies near each of our markers, within centimetres, which the residual shows: Plug-in Gait, with
CMU's names of the waist too, and two sets of OpenSim; and OpenPose's joints."""

_SKIN_OF_SIDE = {
    "shoulder": ("{S}SHO", "{S}_Shoulder", "{S}.Shoulder"),
    "elbow": ("{S}ELB", "{S}_elbow_lat+{S}_elbow_med", "{S}.Elbow"),
    "wrist": ("{S}WRA+{S}WRB", "{S}_wrist_radius+{S}_wrist_ulna", "{S}.Wrist"),
    "hip": (
        "{S}ASI+{S}ASI+{S}PSI+{S}PSI+{S}THI",
        "{S}FWT+{S}FWT+{S}BWT+{S}BWT+{S}THI",
        "{S}_HJC",
        "{S}Hip",
        "{S}.ASIS+{S}.ASIS+{S}.PSIS+{S}.PSIS+{S}.TH1",
    ),
    "knee": ("{S}KNE", "{S}_knee+{S}_mknee", "{S}_knee", "{S}.Knee"),
    "ankle": ("{S}ANK", "{S}_ankle+{S}_mankle", "{S}_ankle", "{S}.Ankle"),
}

_CENTRAL = {
    "pelvis": ("root", "Hips", "hip", "pelvis"),
    "chest": ("upperback", "Chest", "Spine", "Spine2", "chest", "Bip01_Spine1", "spine_02"),
    "neck": ("thorax", "Neck", "neck", "neck_01", "Bip01_Neck"),
    "skull": ("upperneck", "Head", "skull", "Bip01_Head"),
    "crown": ("head_end", "head", "HeadEnd", "Head_end", "HeadTop", "HeadTop_End", "__Jaw", "crown", "Bip01_Head_end"),
}

_OF_SIDE = {  # the far end of an ASF bone; the starts of the others
    "shoulder": ("{s}clavicle", "{Left}Arm", "UpArm_{S}", "UpperArm_{S}", "upper_arm.{S}", "{s}Shldr", "Bip01_{S}_UpperArm"),
    "elbow": ("{s}humerus", "{Left}ForeArm", "LoArm_{S}", "LowerArm_{S}", "forearm.{S}", "{s}ForeArm", "Bip01_{S}_Forearm"),
    "wrist": ("{s}wrist", "{Left}Hand", "Hand_{S}", "hand.{S}", "{s}Hand", "Bip01_{S}_Hand"),
    "hip": ("{s}hipjoint", "{Left}UpLeg", "UpLeg_{S}", "UpperLeg_{S}", "thigh.{S}", "{s}Thigh", "Bip01_{S}_Thigh"),
    "knee": ("{s}femur", "{Left}Leg", "LoLeg_{S}", "LowerLeg_{S}", "shin.{S}", "calf_{s}", "{s}Shin", "Bip01_{S}_Calf"),
    "ankle": ("{s}tibia", "{Left}Foot", "Foot_{S}", "foot.{S}", "{s}Foot", "Bip01_{S}_Foot"),
}


def _sided(marker: str, side: str, left: str) -> tuple[str, ...]:
    patterns = (*_OF_SIDE[marker], f"{left}_{marker}", f"{marker}_{side}", *_SKIN_OF_SIDE[marker])
    return tuple(pattern.format(s=side, S=side.upper(), Left=left.capitalize()) for pattern in patterns)


ALIASES: Mapping[str, tuple[str, ...]] = {
    **{marker: (*names, *_SKIN[marker]) for marker, names in _CENTRAL.items()},
    **{f"{marker}_{side}": _sided(marker, side, left) for side, left in (("l", "left"), ("r", "right")) for marker in _OF_SIDE},
}
"""The names of each of the 17 markers."""

_FOOT_OF_SIDE = {
    "heel": ("{S}HEE", "{S}_calc", "{s}heel"),
    "big_toe": ("{S}TOE", "{S}_toe", "{s}toes", "{Left}ToeBase_end", "{Left}Toe"),
    "small_toe": ("{S}MT5", "{S}_5meta"),
}
FOOT_ALIASES: Mapping[str, tuple[str, ...]] = {
    f"{part}_{side}": tuple(name.format(s=side, S=side.upper(), Left=left) for name in names)
    for part, names in _FOOT_OF_SIDE.items()
    for side, left in (("l", "Left"), ("r", "Right"))
}
"""The names of the markers of feet; those of skin markers lie near ours."""


def segments(torso: str) -> dict[str, str]:
    """Joints by the segments of OpenSim's bodies, as :attr:`poseppl.motion.bodies.body.Body.segments` has them.

    Args:
        torso: The joint that turns the trunk.
    """
    limbs = {"femur": "hip", "tibia": "knee", "humerus": "shoulder", "ulna": "elbow"}
    sided = {f"{segment}_{side}": f"{joint}_{side}" for segment, joint in limbs.items() for side in "lr"}
    return {"pelvis": "pelvis", "torso": torso, **sided}


def foot_segments() -> dict[str, str]:
    """Joints by OpenSim's bodies of the feet: the ankle turns the heel, subtalar joint and all."""
    return {f"calcn_{side}": f"ankle_{side}" for side in "lr"}


def mirrored_angle(angles: Mapping[tuple[str, str], float], joint: str, axis: str) -> float:
    """The angle of a joint about an axis from those of the left side; 0 where none is given."""
    name, _, side = joint.partition("_")
    value = angles.get((name, axis), 0.0)
    return -value if side == "r" and axis in "YZ" else value


def edges_along(trunk: Sequence[str], limbs: Sequence[Sequence[str]]) -> tuple[tuple[str, str], ...]:
    """Pairs of markers that follow each other, along the trunk and along the limbs of both sides, which begin on it."""
    sided = [(start, *(f"{name}_{side}" for name in limb)) for side in "lr" for start, *limb in limbs]
    return tuple(pair for chain in (trunk, *sided) for pair in pairwise(chain))


def neighbours_in(chains: Sequence[Sequence[str]]) -> Callable[[str, str], bool]:
    """Whether two parts meet: each with the next of a chain, on one side or across the middle."""
    neighbours = {frozenset(pair) for chain in chains for pair in pairwise(chain)}

    def meet(first: str, second: str) -> bool:
        (one, side), (other, other_side) = (_split(name) for name in (first, second))
        return frozenset((one, other)) in neighbours and (not side or not other_side or side == other_side)

    return meet


def _split(name: str) -> tuple[str, str]:
    return (name[:-2], name[-1]) if name[-2:] in ("_l", "_r") else (name, "")
