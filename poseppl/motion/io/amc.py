"""The Acclaim motion file (AMC): channel values of each bone of a skeleton, frame by frame.

Positions come from `poseppl.motion.io.asf`'s kinematics, evaluated for all frames at once. The format has no rate; the CMU
database was recorded at 120 Hz.
"""

from __future__ import annotations

from array import array
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.asf import Bone, Skeleton
from poseppl.motion.io.motion import Motion, to_z_up
from poseppl.motion.io.text_parsing import parse_numbers, split_words

CMU_RATE = 120.0
_Floats = NDArray[np.float64]


def read_amc(path: str | PathLike[str], skeleton: Skeleton, *, rate: float = CMU_RATE) -> Motion:
    """Read a motion and place its skeleton in every frame.

    Args:
        path: The .amc file.
        skeleton: Its skeleton, from `poseppl.motion.io.asf.read_asf`.
        rate: Frames a second; the file does not tell.

    Returns:
        The motion, Z up, in mm: the root and the end of every bone, each named after its bone. ``angles`` holds the rotation
        channels of each bone in the order of its ``dof``, in radians, about the skeleton's own (Y-up) axes.

    Raises:
        InputError: The file is truncated or malformed, or does not belong to the skeleton; the message gives the line.
    """
    channels = _read_channels(path, skeleton)
    positions, angles = place_skeleton(skeleton, channels)
    names = tuple(bone.name for bone in skeleton.bones)
    parents = tuple(bone.parent for bone in skeleton.bones)
    return to_z_up(Motion(names, positions, parents, angles, rate, "y", str(path)))


def place_skeleton(skeleton: Skeleton, channels: dict[str, _Floats]) -> tuple[_Floats, dict[str, _Floats]]:
    """Forward kinematics of an Acclaim skeleton.

    Args:
        skeleton: The skeleton, J bones with the root.
        channels: For each bone with dof (T, k) values in the file's units, in the order of its ``dof``.

    Returns:
        Positions (T, J, 3) in mm in the file's axes (Y up), and the rotation channels (T, k) of each bone in radians.
    """
    frames = len(channels["root"])
    turns = np.empty((len(skeleton.bones), frames, 3, 3))
    positions = np.empty((frames, len(skeleton.bones), 3))
    angles: dict[str, _Floats] = {}
    for index, bone in enumerate(skeleton.bones):
        values = channels.get(bone.name, np.zeros((frames, 0)))
        rotations = [k for k, channel in enumerate(bone.dof) if channel[0] == "r"]
        if rotations:
            angles[bone.name] = values[:, rotations] * skeleton.radians_per_unit
        by_axis = np.zeros((frames, 3))
        for column, k in enumerate(rotations):
            by_axis[:, "xyz".index(bone.dof[k][1])] = angles[bone.name][:, column]
        local = euler_rotation(np.asarray(bone.axis), bone.axis_order)
        turn = local @ euler_rotation(by_axis, bone.axis_order) @ local.T
        if bone.parent < 0:
            moved = values[:, [bone.dof.index(channel) for channel in ("tx", "ty", "tz")]]
            turns[index], positions[:, index] = turn, moved * skeleton.mm_per_unit + skeleton.root_position
            continue
        turns[index] = turns[bone.parent] @ turn
        offset = bone.length * np.asarray(bone.direction)
        positions[:, index] = positions[:, bone.parent] + turns[index] @ offset
    return positions, angles


def euler_rotation(angles: _Floats, order: str) -> _Floats:
    """Rotation of Euler angles about fixed axes.

    Args:
        angles: (..., 3) angles about X, Y and Z, in radians.
        order: The order of turning; "XYZ" turns about X first, R = R_z R_y R_x.

    Returns:
        (..., 3, 3) rotation matrices.
    """
    rotation = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for letter in order:
        axis = "XYZ".index(letter)
        j, k = (axis + 1) % 3, (axis + 2) % 3
        single = np.zeros((*angles.shape[:-1], 3, 3))
        single[..., axis, axis] = 1.0
        single[..., j, j] = single[..., k, k] = np.cos(angles[..., axis])
        single[..., k, j] = np.sin(angles[..., axis])
        single[..., j, k] = -single[..., k, j]
        rotation = single @ rotation
    return rotation


def _read_channels(path: str | PathLike[str], skeleton: Skeleton) -> dict[str, _Floats]:
    bones = {bone.name: bone for bone in skeleton.bones}
    moving = [bone.name for bone in skeleton.bones if bone.dof]
    rows = {name: array("d") for name in moving}
    frame, line, first = 0, 0, None
    seen: set[str] = set()
    for line, text in enumerate(read_text(path).split("\n"), start=1):
        words = split_words(text, file=path, line=line)
        if not words or words[0][0] in "#:":
            _check_header(path, line, words, skeleton)
            continue
        if len(words) == 1 and words[0].isascii() and words[0].isdigit() and len(words[0]) < 10:
            if first is not None:
                _check_complete(path, line, frame, moving, seen)
            number = int(words[0])
            if first is not None and number != frame + 1:
                raise InputError(f"frame {number} follows frame {frame}", file=path, line=line, expected=f"{frame + 1}")
            first, frame, seen = (number if first is None else first), number, set()
            continue
        if first is None:
            raise InputError(f"{words[0][:40]!r} before the first frame", file=path, line=line, expected="a frame number")
        _check_row(path, line, words, frame, bones.get(words[0]), seen, skeleton)
        seen.add(words[0])
        if words[0] in rows:
            rows[words[0]].extend(parse_numbers(words[1:], file=path, line=line, field=words[0]))
    if first is None:
        raise InputError("the file holds no frame", file=path, expected="an Acclaim motion (.amc)")
    _check_complete(path, line, frame, moving, seen)
    return {name: np.array(values).reshape(-1, len(bones[name].dof)) for name, values in rows.items()}


def _check_header(path: str | PathLike[str], line: int, words: list[str], skeleton: Skeleton) -> None:
    unit = words[0].lower() if words else ""
    if unit in (":radians", ":degrees") and (unit == ":radians") != (skeleton.radians_per_unit == 1.0):
        raise InputError(f"{unit} differs from the skeleton's unit of angle", file=path, line=line)


def _check_complete(path: str | PathLike[str], line: int, frame: int, moving: list[str], seen: set[str]) -> None:
    missing = [name for name in moving if name not in seen]
    if missing:
        problem = f"frame {frame} lacks {missing[0]!r}" + (f" and {len(missing) - 1} more" if len(missing) > 1 else "")
        raise InputError(problem, file=path, line=line, expected="all bones with dof; is the file truncated?")


def _check_row(
    path: str | PathLike[str],
    line: int,
    words: list[str],
    frame: int,
    bone: Bone | None,
    seen: set[str],
    skeleton: Skeleton,
) -> None:
    if bone is None:
        shown = words[0][:40]
        raise InputError(
            f"the skeleton lacks the joint {shown!r}", file=path, line=line, expected=f"a bone of {skeleton.source}"
        )
    if bone.name in seen:
        raise InputError(f"{bone.name!r} is repeated in frame {frame}", file=path, line=line)
    if len(words) - 1 != len(bone.dof):
        dof = " ".join(bone.dof) or "none"
        problem = f"{len(words) - 1} values in frame {frame}"
        raise InputError(
            problem, file=path, line=line, field=bone.name, expected=f"{len(bone.dof)} ({dof}); is the file truncated?"
        )
