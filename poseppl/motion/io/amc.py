"""The Acclaim motion file (AMC): channel values of each bone of a skeleton, frame by frame.

Positions come from `poseppl.motion.io.asf`'s kinematics, evaluated for all frames at once. The format has no rate; the CMU
database was recorded at 120 Hz.
"""

from __future__ import annotations

from array import array

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.asf import Bone, Skeleton
from poseppl.motion.io.motion import Motion, z_up
from poseppl.motion.io.text_parsing import lines_of_words, parse_numbers

CMU_RATE = 120.0


def read_amc(path: FilePath, skeleton: Skeleton, *, rate: float = CMU_RATE) -> Motion:
    """Read a motion and place its skeleton in every frame.

    Args:
        path: The .amc file.
        skeleton: Its skeleton, from `poseppl.motion.io.asf.read_asf`.
        rate: Frames a second; the file does not tell.

    Returns:
        The motion, Z up, in mm: the root and the end of every bone, each named after its bone.

    Raises:
        InputError: The file is truncated or malformed, or does not belong to the skeleton; the message gives the line.
    """
    positions = place_skeleton(skeleton, _read_channels(path, skeleton))
    names = tuple(bone.name for bone in skeleton.bones)
    parents = tuple(bone.parent for bone in skeleton.bones)
    return Motion(names, z_up(positions, "y"), parents, rate, str(path))


def place_skeleton(skeleton: Skeleton, channels: dict[str, Floats]) -> Floats:
    """Forward kinematics of an Acclaim skeleton.

    Args:
        skeleton: The skeleton, J bones with the root.
        channels: For each bone with dof (T, k) values in the file's units, in the order of its ``dof``.

    Returns:
        Positions (T, J, 3) in mm in the file's axes (Y up).
    """
    frames = len(channels["root"])
    turns: list[Rotation] = []
    positions = np.empty((frames, len(skeleton.bones), 3))
    for index, bone in enumerate(skeleton.bones):
        values = channels.get(bone.name, np.zeros((frames, 0)))
        by_axis = np.zeros((frames, 3))
        for column, channel in enumerate(bone.dof):
            if channel[0] == "r":
                by_axis[:, "xyz".index(channel[1])] = values[:, column] * skeleton.radians_per_unit
        local = euler_rotation(np.asarray(bone.axis), bone.axis_order)
        turn = local * euler_rotation(by_axis, bone.axis_order) * local.inv()
        if bone.parent < 0:
            moved = values[:, [bone.dof.index(channel) for channel in ("tx", "ty", "tz")]]
            positions[:, index] = moved * skeleton.mm_per_unit + skeleton.root_position
        else:
            turn = turns[bone.parent] * turn
            positions[:, index] = positions[:, bone.parent] + turn.apply(bone.length * np.asarray(bone.direction))
        turns.append(turn)
    return positions


def euler_rotation(angles: Floats, order: str) -> Rotation:
    """Rotation of Euler angles about fixed axes.

    Args:
        angles: (T, 3) or (3,) angles about X, Y and Z, in radians.
        order: The order of turning; "XYZ" turns about X first, R = R_z R_y R_x.
    """
    return Rotation.from_euler(order.lower(), angles[..., ["XYZ".index(letter) for letter in order]])


def _read_channels(path: FilePath, skeleton: Skeleton) -> dict[str, Floats]:
    bones = {bone.name: bone for bone in skeleton.bones}
    moving = [bone.name for bone in skeleton.bones if bone.dof]
    rows = {name: array("d") for name in moving}
    at, frame, first = Location(path), 0, None
    seen: set[str] = set()
    for at, words in lines_of_words(path, read_text(path)):
        if words[0][0] in "#:":
            _check_header(at, words, skeleton)
            continue
        if len(words) == 1 and words[0].isascii() and words[0].isdigit() and len(words[0]) < 10:
            if first is not None:
                _check_complete(at, frame, moving, seen)
            number = int(words[0])
            if first is not None and number != frame + 1:
                raise at.error(f"frame {number} follows frame {frame}", f"{frame + 1}")
            first, frame, seen = (number if first is None else first), number, set()
            continue
        if first is None:
            raise at.error(f"{brief(words[0])} before the first frame", "a frame number")
        _check_row(at, words, frame, bones.get(words[0]), seen, skeleton)
        seen.add(words[0])
        if words[0] in rows:
            rows[words[0]].extend(parse_numbers(words[1:], at.in_field(words[0])))
    if first is None:
        raise Location(path).error("the file has no frame", "an Acclaim motion (.amc)")
    _check_complete(at, frame, moving, seen)
    return {name: np.array(values).reshape(-1, len(bones[name].dof)) for name, values in rows.items()}


def _check_header(at: Location, words: list[str], skeleton: Skeleton) -> None:
    unit = words[0].lower()
    if unit in (":radians", ":degrees") and (unit == ":radians") != (skeleton.radians_per_unit == 1.0):
        raise at.error(f"{unit} differs from the skeleton's unit of angle")


def _check_complete(at: Location, frame: int, moving: list[str], seen: set[str]) -> None:
    missing = [name for name in moving if name not in seen]
    if missing:
        problem = f"frame {frame} lacks {brief(missing[0])}" + (f" and {len(missing) - 1} more" if len(missing) > 1 else "")
        raise at.error(problem, "all bones with dof; is the file truncated?")


def _check_row(
    at: Location,
    words: list[str],
    frame: int,
    bone: Bone | None,
    seen: set[str],
    skeleton: Skeleton,
) -> None:
    if bone is None:
        shown = words[0][:40]
        raise at.error(f"the skeleton lacks the joint {brief(shown)}", f"a bone of {skeleton.source}")
    if bone.name in seen:
        raise at.error(f"{brief(bone.name)} is repeated in frame {frame}")
    if len(words) - 1 != len(bone.dof):
        dof = " ".join(bone.dof) or "none"
        problem = f"{len(words) - 1} values in frame {frame}"
        raise at.in_field(bone.name).error(problem, f"{len(bone.dof)} ({dof}); is the file truncated?")
