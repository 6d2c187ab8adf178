"""OpenSim's reading of our files: ``python opensim_reading.py NAME LENGTHS.json OUTPUT.json``, in a process of its own.

Loads NAME.trc and NAME.mot, builds a model whose segments have our body's lengths, and runs OpenSim's inverse kinematics on the
joints of NAME.trc. OpenSim's package warns when it is imported, and writes to the standard output.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import opensim

AXES = {"z": (0, 0, 1), "x": (1, 0, 0), "y": (0, 1, 0)}


def transform(names: list[str], mirrored: bool) -> opensim.SpatialTransform:
    """Rotations about Z, X and Y as OpenSim's full-body models have them; a left side has the last two turned round."""
    found = opensim.SpatialTransform()
    for number, (axis, along) in enumerate(AXES.items()):
        sign = -1 if mirrored and axis != "z" else 1
        one = found.updTransformAxis(number)
        one.setAxis(opensim.Vec3(*(sign * value for value in along)))
        if number < len(names):
            one.setCoordinateNames(opensim.ArrayStr(names[number], 1))
            one.set_function(opensim.LinearFunction(1, 0))
    return found


def vector(right: float = 0.0, forward: float = 0.0, up: float = 0.0) -> opensim.Vec3:
    """A place in a segment, from mm."""
    return opensim.Vec3(forward / 1000, up / 1000, right / 1000)


class Person:
    """A model of so many segments as our body has, with its joints as markers."""

    def __init__(self, size: dict[str, float]) -> None:
        self.model = opensim.Model()
        self.bodies = {"ground": self.model.getGround()}
        zero = opensim.Vec3(0)
        pelvis = self._segment("pelvis")
        free = transform(["pelvis_tilt", "pelvis_list", "pelvis_rotation"], False)
        for number, (name, axis) in enumerate(zip(("tx", "ty", "tz"), ("x", "y", "z"), strict=True), 3):
            one = free.updTransformAxis(number)
            one.setCoordinateNames(opensim.ArrayStr(f"pelvis_{name}", 1))
            one.setAxis(opensim.Vec3(*AXES[axis]))
            one.set_function(opensim.LinearFunction(1, 0))
        joint = opensim.CustomJoint("ground_pelvis", self.bodies["ground"], zero, zero, pelvis, zero, zero, free)
        self.model.addJoint(joint)
        self.marker("pelvis", "pelvis")
        self.joint("torso", "pelvis", vector(), ["lumbar_extension", "lumbar_bending", "lumbar_rotation"])
        self.marker("chest", "torso", up=size["chest"])
        self.marker("neck", "torso", up=size["spine"])
        for side, sign in (("r", 1.0), ("l", -1.0)):
            self._limbs(side, sign, size)
        self.model.finalizeConnections()

    def _segment(self, name: str) -> opensim.Body:
        body = opensim.Body(name, 1.0, opensim.Vec3(0), opensim.Inertia(1, 1, 1))
        self.model.addBody(body)
        self.bodies[name] = body
        return body

    def joint(self, name: str, above: str, place: opensim.Vec3, names: list[str], mirrored: bool = False) -> None:
        """Add a segment that turns about a place of another."""
        zero = opensim.Vec3(0)
        turns = transform(names, mirrored)
        parts = (self.bodies[above], place, zero, self._segment(name), zero, zero, turns)
        self.model.addJoint(opensim.CustomJoint(f"{name}_joint", *parts))

    def marker(self, name: str, segment: str, right: float = 0.0, forward: float = 0.0, up: float = 0.0) -> None:
        """Add a marker."""
        self.model.addMarker(opensim.Marker(name, self.bodies[segment], vector(right, forward, up)))

    def _limbs(self, side: str, sign: float, size: dict[str, float]) -> None:
        hip = {"right": sign * size["hip_width"], "forward": size["hip_forward"], "up": -size["hip_drop"]}
        shoulder = {
            "right": sign * size["shoulder_width"],
            "forward": size["shoulder_forward"],
            "up": size["spine"] - size["shoulder_drop"],
        }
        left = side == "l"
        for name, above, place, parts, ends in (
            ("femur", "pelvis", hip, ("hip_flexion", "hip_adduction", "hip_rotation"), ("hip", "knee", size["thigh"])),
            ("humerus", "torso", shoulder, ("arm_flex", "arm_add", "arm_rot"), ("shoulder", "elbow", size["upper_arm"])),
        ):
            self.joint(f"{name}_{side}", above, vector(**place), [f"{part}_{side}" for part in parts], left)
            self.marker(f"{ends[0]}_{side}", above, **place)
            self.marker(f"{ends[1]}_{side}", f"{name}_{side}", up=-ends[2])
        for name, above, length, bend, end, below in (
            ("tibia", "femur", size["thigh"], "knee_bend", "ankle", size["shank"]),
            ("ulna", "humerus", size["upper_arm"], "elbow_flex", "wrist", size["forearm"]),
        ):
            self.joint(f"{name}_{side}", f"{above}_{side}", vector(up=-length), [f"{bend}_{side}"])
            self.marker(f"{end}_{side}", f"{name}_{side}", up=-below)


def inverse_kinematics(model: opensim.Model, markers: str, output: str) -> dict[str, list[float]]:
    """Angles that OpenSim finds, by coordinate."""
    tool = opensim.InverseKinematicsTool()
    tool.setModel(model)
    tool.setMarkerDataFileName(markers)
    table = opensim.MarkerData(markers)
    tool.setStartTime(table.getStartFrameTime())
    tool.setEndTime(table.getLastFrameTime())
    tool.setOutputMotionFileName(output)
    assert tool.run()
    return columns(opensim.TimeSeriesTable(output))


def columns(table: opensim.TimeSeriesTable) -> dict[str, list[float]]:
    """A table as lists by column."""
    found = {name: list(table.getDependentColumn(name).to_numpy()) for name in table.getColumnLabels()}
    return {"time": list(table.getIndependentColumn()), **found}


def table_rows(column: opensim.VectorViewVec3) -> list[list[float]]:
    """A column of places as lists."""
    return [[column[row][axis] for axis in range(3)] for row in range(column.size())]


def main(stem: str, lengths: str, output: str) -> None:
    """Write what OpenSim read and found."""
    markers, angles = opensim.TimeSeriesTableVec3(f"{stem}.trc"), opensim.Storage(f"{stem}.mot")
    places = {name: table_rows(markers.getDependentColumn(name)) for name in markers.getColumnLabels()}
    read = {
        "times": list(markers.getIndependentColumn()),
        "units": opensim.MarkerData(f"{stem}.trc").getUnits().getLabel(),
        "rate": opensim.MarkerData(f"{stem}.trc").getDataRate(),
        "places": places,
        "in_degrees": angles.isInDegrees(),
        "angles": columns(opensim.TimeSeriesTable(f"{stem}.mot")),
        "found": inverse_kinematics(Person(json.loads(Path(lengths).read_text())).model, f"{stem}.trc", f"{stem}_ik.mot"),
        "found with ours": inverse_kinematics(opensim.Model(f"{stem}.osim"), f"{stem}.trc", f"{stem}_ik_ours.mot"),
    }
    Path(output).write_text(json.dumps(read))


if __name__ == "__main__":
    main(*sys.argv[1:])
