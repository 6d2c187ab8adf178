"""A result's mean motion as a rig for animation: joints under the names of Mixamo's or Blender's rigs, as a BVH file.

The hierarchy is the body's own. Its root stands for the hips and turns with the trunk; the joint ``pelvis`` below it, which
rigs lack, turns the legs. A joint whose angles no camera saw is at rest, and its name ends in ``_unseen``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.bodies.opensim import opensim_coordinates
from poseppl.motion.geometry.tree import KinematicTree
from poseppl.motion.io.bvh import UNITS_MM, BvhJoint, write_bvh
from poseppl.motion.io.motion import y_up
from poseppl.motion.tracking.estimates import clock_of, unseen_of
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.runs.contents import variable

Rig = Literal["poseppl", "mixamo", "blender"]
UNSEEN = "_unseen"
_MIXAMO = {"shoulder": "Arm", "elbow": "ForeArm", "hip": "UpLeg", "knee": "Leg", "ankle": "Foot"}
_BLENDER = {"shoulder": "upper_arm", "elbow": "forearm", "hip": "thigh", "knee": "shin", "ankle": "foot"}
RIGS: Mapping[str, Callable[[str, str], str]] = {
    "poseppl": lambda part, side: f"{part}_{side}",
    "mixamo": lambda part, side: f"mixamorig:{'Left' if side == 'l' else 'Right'}{_MIXAMO.get(part, part)}",
    "blender": lambda part, side: f"{_BLENDER.get(part, part)}.{side.upper()}",
}
"""Names of joints of the limbs: those of Mixamo's characters, and of Blender's Rigify."""
TRUNKS: Mapping[str, Mapping[str, str]] = {
    "poseppl": {},
    "mixamo": {"spine": "mixamorig:Hips", "girdle": "mixamorig:Spine2", "head": "mixamorig:Head", "pelvis": "mixamorig:Pelvis"},
    "blender": {"spine": "spine", "girdle": "spine.003", "head": "spine.006", "pelvis": "pelvis"},
}
"""Names of the joints of the trunk."""


def write_rig(path: FilePath, tree: xr.DataTree, rig: Rig = "mixamo", unit: str = "cm", model: str | None = None) -> None:
    """Write the mean motion of a result.

    Args:
        path: The .bvh file, overwritten if it exists.
        tree: A result of a whole body.
        rig: Whose names joints have.
        unit: Unit of lengths: "mm", "cm" or "m".
        model: Builder of the body, where the result's own is not installed.

    Raises:
        InputError: The rig or the unit is unknown, the body's joints are partly clamped, or the file cannot be written.
        PosepplError: The disk is full.
    """
    if rig not in RIGS or unit not in UNITS_MM:
        field, known = ("rig", RIGS) if rig not in RIGS else ("unit", UNITS_MM)
        raise InputError(repr(rig if rig not in RIGS else unit), field=Argument(field), expected=", ".join(known))
    body = recorded_model(tree, model).body
    states = variable(tree, "summary", "state_mean")
    if states is None or body.free is not None:
        raise InputError(
            "a rig is of a whole body", field=Argument("format", "bvh"), expected="a result without clamped joints"
        )
    hidden = _hidden_joints(body, unseen_of(tree).coordinates)
    turns = np.stack([_turns(body.tree, joint, states, joint in hidden) for joint in body.tree.joint_names], 1)
    write_bvh(path, _joints(body, rig, hidden), turns, y_up(np.asarray(states[:, :3], np.float64)), clock_of(tree).rate, unit)


def _hidden_joints(body: Body, unseen: Sequence[str]) -> set[str]:
    """Joints all of whose angles no camera saw."""
    coordinates = opensim_coordinates(body)
    moved = {joint: [each.name for each in coordinates if each.joints[-1] == joint] for joint in body.tree.joint_names}
    return {joint for joint, names in moved.items() if names and set(names) <= set(unseen)}


def _turns(tree: KinematicTree, joint: str, states: Floats, hidden: bool) -> Floats:
    """Rotations (T, 3, 3) of a joint relative to the one above, Y up."""
    index = [k for k, (name, axis) in enumerate(tree.coordinates) if name == joint and axis in "XYZ"]
    axes, angles = "".join(tree.coordinates[k][1] for k in index), np.asarray(states[:, index], np.float64)
    turned = Rotation.from_euler(axes, np.zeros_like(angles) if hidden else angles)
    upright = Rotation.from_matrix(y_up(np.eye(3)).T)
    return np.asarray((upright * turned * upright.inv()).as_matrix())


def _joints(body: Body, rig: str, hidden: set[str]) -> list[BvhJoint]:
    """The hierarchy, with markers that have no joint below them as ends."""
    tree, names = body.tree, body.tree.joint_names
    first = {name: tree.link_joint.index(k) for k, name in enumerate(names)}
    found = []
    for name in names:
        parent = tree.parents[first[name]]
        marks = [k for k, link in enumerate(tree.marker_link) if link == tree.last_links[name]]
        leaf = all(tree.parents[link] != tree.last_links[name] for link in range(len(tree.parents)))
        ends = [y_up(np.asarray(tree.marker_offsets[k], np.float64)) for k in marks if leaf and np.any(tree.marker_offsets[k])]
        part, _, side = name.rpartition("_")
        called = RIGS[rig](part, side) if side in ("l", "r") else TRUNKS[rig].get(name, name)
        above = -1 if parent < 0 else names.index(names[tree.link_joint[parent]])
        offset = y_up(np.asarray(tree.offsets[first[name]], np.float64)) if parent >= 0 else np.zeros(3)
        found.append(BvhJoint(called + UNSEEN * (name in hidden), above, offset, ends[:1]))
    return found
