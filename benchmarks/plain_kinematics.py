"""The rivals: kinematics as one would first write them, by products of 3x3 matrices, and MuJoCo's on an equal tree."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.motion.geometry import KinematicTree

UNIT = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}


def plain_log_density(tree: KinematicTree, centre: tuple[float, float, float], points: jax.Array, noise: float) -> Callable:
    """Log-likelihood of one state, up to a constant, for the paper's camera (Eq. 18); to be vmapped and differentiated.

    Args:
        tree: The body.
        centre: The camera's, mm.
        points: Image points (markers, 2).
        noise: Their standard deviation.
    """
    offsets, marker_offsets = np.asarray(tree.offsets, np.float32), np.asarray(tree.marker_offsets, np.float32)

    def log_density(state: jax.Array) -> jax.Array:
        frames: list[tuple[jax.Array, jax.Array]] = []
        for link, parent in enumerate(tree.parents):
            turn, origin = frames[parent] if parent >= 0 else (jnp.eye(3), state[:3])
            if parent >= 0:
                origin = origin + turn @ offsets[link]
            for axis, index in zip("ZYX", tree.angle_index[link], strict=True):
                if index >= 0:
                    turn = turn @ _rotation(axis, state[index])
            frames.append((turn, origin))
        place = jnp.stack(
            [frames[link][1] + frames[link][0] @ marker_offsets[marker] for marker, link in enumerate(tree.marker_link)]
        ) - jnp.array(centre)
        image = place[:, ::2] / place[:, 1:2]
        return -0.5 * jnp.sum(((image - points) / noise) ** 2)

    return log_density


def _rotation(axis: str, angle: jax.Array) -> jax.Array:
    c, s = jnp.cos(angle), jnp.sin(angle)
    rows = {
        "X": [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]],
        "Y": [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        "Z": [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
    }[axis]
    return jnp.stack([jnp.stack([jnp.asarray(entry, angle.dtype) for entry in row]) for row in rows])


def mujoco_xml(tree: KinematicTree) -> str:
    """MuJoCo's description of the same tree: slides and hinges in the state's order within each body, markers as sites."""
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian")
    bodies = [ElementTree.SubElement(root, "worldbody")]
    for link, parent in enumerate(tree.parents):
        above = bodies[parent + 1]
        body = ElementTree.SubElement(above, "body", pos=_numbers(tree.offsets[link] if parent >= 0 else np.zeros(3)))
        ElementTree.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
        if parent < 0:
            for index, axis in enumerate("XYZ"):
                ElementTree.SubElement(body, "joint", name=str(index), type="slide", axis=UNIT[axis])
        for axis, index in zip("ZYX", tree.angle_index[link], strict=True):
            if index >= 0:
                ElementTree.SubElement(body, "joint", name=str(index), type="hinge", axis=UNIT[axis])
        for marker, place in enumerate(tree.marker_link):
            if place == link:
                position = _numbers(tree.marker_offsets[marker])
                ElementTree.SubElement(body, "site", name=str(marker), pos=position)
        bodies.append(body)
    return ElementTree.tostring(root, encoding="unicode")


def _numbers(vector: Any) -> str:
    return " ".join(f"{float(value):.9g}" for value in vector)


class MuJoCo:
    """MuJoCo's forward kinematics, a state at a time on one core, from C.

    Raises:
        ImportError: MuJoCo is not installed.
    """

    def __init__(self, tree: KinematicTree) -> None:
        import mujoco

        self.kinematics = mujoco.mj_kinematics
        self.model = mujoco.MjModel.from_xml_string(mujoco_xml(tree))
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(str(index)).qposadr[0] for index in range(tree.dimension)]
        self.order = np.argsort(joints)  # of the state, to be MuJoCo's
        self.sites = [self.model.site(str(marker)).id for marker in range(len(tree.marker_link))]

    def markers(self, state: np.ndarray) -> np.ndarray:
        """Marker positions (markers, 3) of one state."""
        self.data.qpos[:] = state[self.order]
        self.kinematics(self.model, self.data)
        return self.data.site_xpos[self.sites].copy()

    def run(self, states: np.ndarray) -> None:
        """Do all states, keeping nothing: the calls alone."""
        qpos, model, data, kinematics = self.data.qpos, self.model, self.data, self.kinematics
        for row in states:
            qpos[:] = row
            kinematics(model, data)


class MJX:
    """MuJoCo's kinematics in JAX.

    Raises:
        ImportError: MuJoCo or its JAX part is not installed.
    """

    def __init__(self, tree: KinematicTree) -> None:
        from mujoco import mjx

        self.order = MuJoCo(tree).order
        model = mjx.put_model(MuJoCo(tree).model)
        data = mjx.make_data(model)
        sites = np.array(MuJoCo(tree).sites)
        self.markers = lambda state: mjx.kinematics(model, data.replace(qpos=state[self.order])).site_xpos[sites]
