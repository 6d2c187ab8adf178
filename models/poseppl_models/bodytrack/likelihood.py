"""The body and the likelihood of the bodytrack benchmark (Deutscher and Reid 2005, doi:10.1023/B:VISI.0000043757.18370.9c).

31 coordinates and 10 elliptical cones. The benchmark's rotation from three angles is E(a, b, c) = Rz(c) Rx(a) Ry(b), inverted
at every joint except the pelvis, with fixed quarter turns between the joints. Here the fixed turns are carried out to the
leaves: they only permute axes and change signs, so that the body is a plain kinematic tree. A pose of the benchmark is a state
with its coordinates reordered and some of them negated (:meth:`BodytrackBody.state_of`).

The likelihood has no noise of its own: of edge samples along the sides of all parts in all cameras, and of samples inside,

    log L = -(mean of (1 - E)^2 + mean of (1 - FG)),

E being the edge map and FG the foreground (:func:`poseppl.motion.vision.edges.benchmark_edge_map`). Annealing gives it a width;
as a density it stands for temperature 1 / beta, with `beta` among the params.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
from jax import Array

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, Joint, KinematicTree, Marker, kinematic_tree
from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.coverage import outline_corners
from poseppl.motion.geometry.flesh import Cone, Flesh, flesh_of, parts_of
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.random_walk import walking_body
from poseppl_models.bodytrack.outline_samples import Room, Spacing, Sums, fixed_sums, spaced_sums


class ImageInputs(NamedTuple):
    """Inputs of one frame.

    Attributes:
        cameras: C cameras.
        edge_error: (1 - E)^2, E in [0, 1] being the edge map, padded: (C, H + 1, W).
        inside_error: 1 where the background is, 0 on the foreground, padded: (C, H + 1, W).
        start: Mean of the first state (d,).
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,).
    """

    cameras: Cameras
    edge_error: Array
    inside_error: Array
    start: Array
    start_scale: Array
    step_scale: Array


class BodytrackBody(NamedTuple):
    """The body.

    Attributes:
        tree: Its markers are the far ends of the parts.
        flesh: The cones.
        order: Which entry of the benchmark's pose each coordinate is (31,).
        signs: And its sign (31,).
    """

    tree: KinematicTree
    flesh: Flesh
    order: Floats
    signs: Floats

    def state_of(self, pose: Any) -> Floats:
        """States (..., 31) of poses (..., 31) of the benchmark: position in mm, angles in radians."""
        return np.asarray(pose)[..., self.order] * self.signs


class _Joint(NamedTuple):
    """A joint of the benchmark: fixed turns before it (axis and quarter turns), then its inverted rotation.

    ``entries`` are the entries of the pose that turn about Y, X and Z, in this order, -1 for none.
    """

    name: str
    parent: str
    shift: tuple[float, float, float]
    turns: Sequence[tuple[str, int]]
    entries: tuple[int, int, int]


def bodytrack_body(shape: Any) -> BodytrackBody:
    """Build the body from the 58 numbers of ``BodyShapeParameters.txt``.

    Args:
        shape: For each of 10 parts its radii at the base and at the tip (mm) and two factors, then 18 lengths (mm).

    Raises:
        ValueError: Not 58 numbers.
    """
    values = np.asarray(shape, float).ravel()
    if values.shape != (58,):
        raise ValueError(f"a body has {values.size} numbers; expected 58: 10 parts of 4, and 18 lengths (mm)")
    radii, size = values[:40].reshape(10, 4), values[40:]
    joints = _joints(size)
    frames: dict[str, Floats] = {"pelvis": np.eye(3)}
    laid = [Joint("pelvis", None, (0.0, 0.0, 0.0), "ZXY")]
    coordinates = [(3, 1.0), (4, 1.0), (5, 1.0), (2, 1.0), (0, 1.0), (1, 1.0)]
    for joint in joints:
        above = frames[joint.parent]
        frame = above @ _fixed(joint.turns)
        frames[joint.name] = frame
        axes = ""
        for axis, entry in zip((1, 0, 2), joint.entries, strict=True):
            if entry >= 0:
                place = int(np.argmax(np.abs(frame[:, axis])))
                axes += "XYZ"[place]
                coordinates.append((entry, -float(frame[place, axis])))
        laid.append(Joint(joint.name, joint.parent, tuple(above @ np.array(joint.shift)), axes))
    cones, markers = [], []
    for row, (name, joint_name, length) in zip(radii, _parts(size), strict=True):
        frame = frames[joint_name]
        pair, scale = (float(row[0]), float(row[1])), (float(row[2]), float(row[3]))
        cones.append(Cone(name, joint_name, length, pair, scale, axis=tuple(frame[:, 2]), across=tuple(frame[:, 0])))
        markers.append(Marker(name, joint_name, tuple(frame[:, 2] * length)))
    tree = kinematic_tree(laid, markers)
    order, signs = (np.array(column) for column in zip(*coordinates, strict=True))
    return BodytrackBody(tree, flesh_of(tree, cones), order, signs)


LIMBS = {
    "trunk": ("pelvis",),
    "leg_l": ("hip_l", "knee_l"),
    "leg_r": ("hip_r", "knee_r"),
    "thorax": ("thorax",),
    "arm_l": ("clavicle_l", "shoulder_l", "elbow_l"),
    "arm_r": ("clavicle_r", "shoulder_r", "elbow_r"),
    "head": ("neck",),
}
"""Joints of each limb."""


def limb_groups(body: BodytrackBody) -> list[list[int]]:
    """Coordinates of each limb: the groups in which two parents are crossed.

    The likelihood is nearly a sum over limbs, so that one particle may have found a leg and another an arm. A child that takes
    each whole limb from either of two parents can have both (Deutscher, Davison and Reid 2001, doi:10.1109/CVPR.2001.991028). A
    limb that is cut in two would fit nowhere.

    Returns:
        Seven groups of indices into the state, which together are all 31, for the ``crossover`` of
        :func:`poseppl.filters.annealed_filter`.
    """
    owners = [joint for joint, _ in body.tree.coordinates]
    return [[index for index, owner in enumerate(owners) if owner in joints] for joints in LIMBS.values()]


def _joints(size: Floats) -> list[_Joint]:
    arm = (("X", -1), ("Z", 2), ("Y", -1))
    return [
        _Joint("hip_l", "pelvis", (0.0, size[1], 0.0), (("Y", 2),), (7, 6, 8)),
        _Joint("knee_l", "hip_l", (0.0, 0.0, size[2]), (), (9, -1, -1)),
        _Joint("hip_r", "pelvis", (0.0, -size[5], 0.0), (("Y", 2),), (11, 10, 12)),
        _Joint("knee_r", "hip_r", (0.0, 0.0, size[6]), (), (13, -1, -1)),
        _Joint("thorax", "pelvis", (0.0, 0.0, 0.0), (("X", 2),), (26, -1, 27)),
        _Joint("clavicle_l", "thorax", (0.0, 0.0, -size[0]), (("X", -1),), (15, 14, -1)),
        _Joint("shoulder_l", "clavicle_l", (0.0, 0.0, -size[9]), arm, (17, 16, 18)),
        _Joint("elbow_l", "shoulder_l", (0.0, 0.0, -size[10]), (), (19, -1, -1)),
        _Joint("clavicle_r", "thorax", (0.0, 0.0, -size[0]), (("X", 1),), (21, 20, -1)),
        _Joint("shoulder_r", "clavicle_r", (0.0, 0.0, -size[13]), arm, (23, 22, 24)),
        _Joint("elbow_r", "shoulder_r", (0.0, 0.0, -size[14]), (), (25, -1, -1)),
        _Joint("neck", "thorax", (0.0, 0.0, -size[0]), (("X", 2),), (29, 28, 30)),
    ]


def _parts(size: Floats) -> list[tuple[str, str, float]]:
    """Name, joint and signed length of each part, in the benchmark's order."""
    return [
        ("torso", "pelvis", size[0]),
        ("thigh_l", "hip_l", size[2]),
        ("shank_l", "knee_l", size[3]),
        ("thigh_r", "hip_r", size[6]),
        ("shank_r", "knee_r", size[7]),
        ("upper_arm_l", "shoulder_l", -size[10]),
        ("forearm_l", "elbow_l", -size[11]),
        ("upper_arm_r", "shoulder_r", -size[14]),
        ("forearm_r", "elbow_r", -size[15]),
        ("head", "neck", size[17]),
    ]


def _fixed(turns: Sequence[tuple[str, int]]) -> Floats:
    """Product of quarter turns about the axes."""
    frame = np.eye(3)
    for axis, quarters in turns:
        first, second = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
        turn = np.eye(3)
        cosine, sine = round(np.cos(quarters * np.pi / 2)), round(np.sin(quarters * np.pi / 2))
        turn[first, first] = turn[second, second] = cosine
        turn[first, second], turn[second, first] = -sine, sine
        frame = frame @ turn
    return frame


def _rooms(torso: Room, leg: Room, arm: Room, head: Room) -> tuple[Room, ...]:
    return (torso, *(leg,) * 4, *(arm,) * 4, head)


FEW = _rooms(Room(18, 9, 5), Room(12, 6, 4), Room(7, 4, 4), Room(9, 4, 4))
"""Intervals of each part that are about 5 and 10 px long in the benchmark's cameras: 488 samples a camera."""
ALL = _rooms(Room(31, 15, 8), Room(23, 11, 6), Room(15, 7, 5), Room(15, 8, 7))
"""Room for all samples of a person who comes a third nearer."""


_CHUNK = 128
"""Particles at a time: some 500 samples of each in 4 cameras fit the cache."""


def outline_sums(body: BodytrackBody, state: Array, inputs: ImageInputs, *, every: bool = False) -> Sums:
    """Sums of the errors over the samples, camera by camera, of one state (d,).

    Args:
        body: The body.
        state: Shape (d,).
        inputs: Cameras and maps.
        every: Whether every sample is taken that the benchmark takes, as far as there is room; otherwise few.
    """

    def sums(tree: KinematicTree, flesh: Flesh, state: Array, cameras: Cameras, edge: Any, inside: Any) -> Sums:
        corners = outline_corners(cameras, flesh, parts_of(tree, flesh, state))
        return (spaced_sums if every else fixed_sums)(corners, edge[..., 0], inside[..., 0], Spacing(), ALL if every else FEW)

    seen = inputs.cameras, inputs.edge_error, inputs.inside_error
    result: Sums = batch_last(sums, chunk=_CHUNK)(body.tree, body.flesh, state, *seen)
    return result


def benchmark_score(body: BodytrackBody, state: Array, inputs: ImageInputs, *, every: bool = False) -> Array:
    """Score of a state, log L, pooled over cameras; arguments as of :func:`outline_sums`."""
    sums = outline_sums(body, state, inputs, every=every)
    return -(jnp.sum(sums.edge) / jnp.sum(sums.num_edge) + jnp.sum(sums.inside) / jnp.sum(sums.num_inside))


def bodytrack(body: BodytrackBody, *, every: bool = False) -> StateSpaceModel:
    """Write the programs: a Gaussian random walk seen through the benchmark's likelihood; inputs are :class:`ImageInputs`.

    Args:
        body: The body.
        every: Whether every sample of the benchmark is taken.
    """

    def observe(params: Any, pose: Array, inputs: ImageInputs) -> None:
        numpyro.factor("image", params["beta"] * benchmark_score(body, pose, inputs, every=every))

    return walking_body(body.tree.coordinates, observe)
