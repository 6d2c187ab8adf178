"""Joint angles as the full-body models of OpenSim have them (Rajagopal et al. 2016, doi:10.1109/TBME.2016.2586891).

A body's joints have coordinates of their own; programs for biomechanics use those of OpenSim's models. A body declares which of
its joints turn OpenSim's segments (:attr:`~poseppl.motion.bodies.body.Body.segments`). The rotation between two segments is
then decomposed as OpenSim composes it: about Z (right), then X (forward), then Y (up), each in the frame turned so far,

    R_above^T R_below = R_Z(a) R_X(b) R_Y(c),    b = asin R_32,  a = atan2(-R_12, R_22),  c = atan2(-R_31, R_33),

and for the left side with the signs of the last two exchanged. The pelvis is relative to the ground, whose Y is up. If b is
near 90 degrees, as in an arm that points sideways, only the sum of a and c is determined, and both have wide intervals.

Coordinates that OpenSim's models do not have keep their own names.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry.kinematics import frames_of

GROUND = "ground"


class Rotations(NamedTuple):
    """Angles between two segments.

    Attributes:
        above: The segment that they are relative to.
        below: The segment.
        names: Coordinates, about Z, X and Y; a hinge has the first alone, an ankle the first two.
        signs: Sign of each.
        meanings: Meaning of each, where it is positive.
    """

    above: str
    below: str
    names: tuple[str, ...]
    signs: tuple[int, ...]
    meanings: tuple[str, ...]


def _sided(side: str) -> list[Rotations]:
    word, mirror = {"r": "right", "l": "left"}[side], 1 if side == "r" else -1
    ball = (1, mirror, mirror)
    hip = tuple(f"{name}_{side}" for name in ("hip_flexion", "hip_adduction", "hip_rotation"))
    arm = tuple(f"{name}_{side}" for name in ("arm_flex", "arm_add", "arm_rot"))
    turns = (
        "flexion of the {} {}: it swings forward",
        "adduction of the {} {}: towards the middle",
        "internal rotation of the {} {}",
    )
    femur, humerus = f"femur_{side}", f"humerus_{side}"
    return [
        Rotations("pelvis", femur, hip, ball, tuple(turn.format(word, "thigh") for turn in turns)),
        Rotations(
            femur, f"tibia_{side}", (f"knee_angle_{side}",), (-1,), (f"flexion of the {word} knee, 0 where it is straight",)
        ),
        Rotations(
            f"tibia_{side}",
            f"calcn_{side}",
            (f"ankle_angle_{side}", f"subtalar_angle_{side}"),
            (1, mirror),
            (
                f"dorsiflexion of the {word} ankle, 0 where the sole is at a right angle to the shank",
                f"inversion of the {word} foot: the sole turns towards the middle",
            ),
        ),
        Rotations("torso", humerus, arm, ball, tuple(turn.format(word, "upper arm") for turn in turns)),
        Rotations(
            humerus, f"ulna_{side}", (f"elbow_flex_{side}",), (1,), (f"flexion of the {word} elbow, 0 where it is straight",)
        ),
    ]


ROTATIONS: tuple[Rotations, ...] = (
    Rotations(
        GROUND,
        "pelvis",
        ("pelvis_tilt", "pelvis_list", "pelvis_rotation"),
        (1, 1, 1),
        (
            "tilt of the pelvis: its front rises (a pelvis bent forward is negative)",
            "list of the pelvis: its right side sinks",
            "heading of the pelvis: 0 along the ground's X, positive to the left",
        ),
    ),
    Rotations(
        "pelvis",
        "torso",
        ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
        (1, 1, 1),
        (
            "the trunk against the pelvis, bent backward",
            "the trunk against the pelvis, bent to the right",
            "the trunk against the pelvis, turned to the left",
        ),
    ),
    *_sided("r"),
    *_sided("l"),
)
"""The angles of OpenSim's models, by the segments that they are between."""
PLACES = {
    "pelvis_tx": "place of the body's pelvis, along the ground's X",
    "pelvis_ty": "place of the body's pelvis, upward",
    "pelvis_tz": "place of the body's pelvis, along the ground's Z",
}
"""Translations, m. OpenSim's pelvis has its origin between the front spines of the ilium, ours where the joint is."""


class Coordinate(NamedTuple):
    """A coordinate of a motion file.

    Attributes:
        name: Its name there.
        unit: "degrees" or "m".
        joints: Our joints that it is made of, the last the one that moves.
        meaning: Its meaning, where it is positive.
    """

    name: str
    unit: str
    joints: tuple[str, ...]
    meaning: str

    @property
    def description(self) -> str:
        """One line that says what it is."""
        return f"{self.name}: {self.meaning}; {self.unit}, from {' and '.join(self.joints)}"


def opensim_coordinates(body: Body) -> tuple[Coordinate, ...]:
    """The coordinates that :func:`opensim_values` gives of a body, in its order."""
    known = body.segments
    found = []
    for each in rotations_of(body):
        joints = tuple(known[segment] for segment in (each.above, each.below) if segment in known)
        found += [Coordinate(name, "degrees", joints, text) for name, text in zip(each.names, each.meanings, strict=True)]
    if "pelvis" in known:
        found += [Coordinate(name, "m", (known["pelvis"],), text) for name, text in PLACES.items()]
    for index in own_coordinates(body):
        joint, axis = body.tree.coordinates[index]
        unit = "m" if axis.startswith("t") else "degrees"
        text = "our own, place with Z up" if unit == "m" else f"our own, about the joint's {axis}"
        found.append(Coordinate(f"{joint}.{axis}", unit, (joint,), text))
    return tuple(found)


def opensim_values(body: Body, states: Array) -> Array:
    """Values (N, coordinates) of :func:`opensim_coordinates` in states (N, d), degrees within half a turn, and m."""
    tree = body.tree
    frames = frames_of(tree.with_offsets(tree.offsets[..., None], tree.marker_offsets[..., None]), states.T)
    turns, origins = jnp.moveaxis(frames.rotation, -1, 1), jnp.moveaxis(frames.origin, -1, 1)
    link = tree.last_links
    axes = {segment: turns[link[joint]] @ SEGMENT_AXES for segment, joint in body.segments.items()}
    axes[GROUND] = jnp.asarray(_GROUND_OF_WORLD.T)
    values = []
    for each in rotations_of(body):
        angles = _angles(jnp.swapaxes(axes[each.above], -1, -2) @ axes[each.below])
        values += [sign * angle for sign, angle in zip(each.signs, angles, strict=False)]
    columns = [jnp.rad2deg(value) for value in values]
    if "pelvis" in body.segments:
        place = origins[link[body.segments["pelvis"]]] @ _GROUND_OF_WORLD.T / 1000.0
        columns += list(place.T)
    for index in own_coordinates(body):
        columns.append(states[:, index] / 1000.0 if index < 3 else jnp.rad2deg(states[:, index]))
    return jnp.stack(columns, -1)


def rotations_of(body: Body) -> list[Rotations]:
    """The angles of OpenSim's models that a body has."""
    known = {GROUND, *body.segments}
    return [each for each in ROTATIONS if {each.above, each.below} <= known]


def own_coordinates(body: Body) -> list[int]:
    """Coordinates of the state that no angle between segments tells."""
    free = {body.segments[each.below] for each in rotations_of(body)}
    return [i for i, (joint, _) in enumerate(body.tree.coordinates) if joint not in free]


def _angles(rotation: Array) -> tuple[Array, Array, Array]:
    """About Z, X and Y, of rotations (..., 3, 3)."""
    along = jnp.arcsin(jnp.clip(rotation[..., 2, 1], -1.0, 1.0))
    return (
        jnp.arctan2(-rotation[..., 0, 1], rotation[..., 1, 1]),
        along,
        jnp.arctan2(-rotation[..., 2, 0], rotation[..., 2, 2]),
    )


SEGMENT_AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Columns: OpenSim's X (forward), Y (up) and Z (right) of a segment in our axes, x right, y forward, z up."""
_GROUND_OF_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From our world, Z up, to OpenSim's ground, Y up."""


def states_to_values(body: Body, draws: Array) -> Array:
    """:func:`opensim_values` of draws (S, T, d), a frame at a time: (S, T, coordinates)."""
    by_frame = jax.lax.map(lambda states: opensim_values(body, states), jnp.swapaxes(draws, 0, 1))
    return jnp.swapaxes(by_frame, 0, 1)


def circular_summary(degrees: np.ndarray, levels: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, standard deviation and quantiles of angles about their mean direction.

    Args:
        degrees: (S, T, K) draws.
        levels: Levels of the quantiles.

    Returns:
        (T, K), (T, K) and (levels, T, K), degrees; means go on from frame to frame without a jump of a turn.
    """
    phases = np.exp(1j * np.deg2rad(degrees)).mean(0)
    centre = np.rad2deg(np.angle(phases))
    beside = (degrees - centre + 180.0) % 360.0 - 180.0
    mean = np.unwrap(centre + beside.mean(0), axis=0, period=360.0)
    spread = beside.std(0, ddof=1) if len(beside) > 1 else np.zeros_like(mean)
    ends = np.quantile(beside, levels, axis=0) - beside.mean(0)
    return mean, spread, mean + ends
