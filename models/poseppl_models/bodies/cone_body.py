"""Bodies of cones on one skeleton, which the published image-based trackers share, and their fit to a person of known joints.

The skeleton's joints are a pelvis (the root, between the hips), a thorax at the same position, shoulders, elbows, wrists, hips,
knees and ankles. A neck and two clavicles lie where the shoulders' line crosses the midline. A body declares the rotation axes
of each joint, "" for none, and the cones that it moves. z points up, y forward, x to the right; limbs hang along -z. Elbows
bend by positive rotations about X, and knees by negative ones. Left limbs are lifted sideways by positive rotations about Y,
right limbs by negative ones. Parts have the name of their segment, with ``_l`` or ``_r``.

The joints are virtual markers, as :func:`poseppl.motion.tracking.marker_errors.virtual_markers` gives them: the pelvis between
the hips, the neck between the shoulders, the end of the head (``crown``), and six joints of the limbs on either side.

>>> import numpy as np
>>> from poseppl_models.darby.body import darby_body
>>> body = darby_body()
>>> rest = dict(zip(body.tree.marker_names, np.asarray(marker_positions(body.tree, jnp.asarray(body.rest)))[:, None]))
>>> round(fitted_stature(measured_lengths(rest)), 1)
1750.0
>>> states = fitted_states(body, rest)
>>> bool(np.allclose(marker_positions(body.tree, jnp.asarray(states[0])), np.concatenate(list(rest.values())), atol=1.0))
True
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.motion.geometry import Joint, KinematicTree, Marker, kinematic_tree, marker_positions
from poseppl.motion.geometry.flesh import Cone, Flesh, flesh_of
from poseppl_models.bodies.anthropometry import LENGTH_SHARES, TORSO_DEPTH, segment_lengths, segment_radii
from poseppl_models.bodies.joint_angles import joint_limits
from poseppl_models.bodies.joint_names import mirrored_angle, neighbours_in

Pairs = tuple[tuple[int, int], ...]
_CHAINS = (("torso", "upper_arm", "forearm", "hand"), ("torso", "thigh", "shank", "foot"), ("torso", "head"))
REST = {("knee", "X"): -0.2, ("hip", "X"): 0.1, ("elbow", "X"): 0.2, ("shoulder", "Y"): 0.2}
"""Angles (radians) of the left side of a person at rest; a little bent, which distinguishes front from back."""


class ConeBody(NamedTuple):
    """A body of cones.

    Attributes:
        tree: The kinematic tree; its markers are the joints, and the ends of head, hands and feet.
        flesh: The cones.
        limits: Least and largest value of each coordinate (d, 2), radians; infinite where nothing limits it.
        apart: Pairs of parts that cannot meet: all but those that meet at a joint.
        rest: State of a person at rest at the origin (d,).
    """

    tree: KinematicTree
    flesh: Flesh
    limits: Floats
    apart: Pairs
    rest: Floats


def cone_body(lengths: Mapping[str, float], axes: Mapping[str, str], cones: Sequence[Cone]) -> ConeBody:
    """Put cones on the skeleton.

    Args:
        lengths: Segment lengths as by :func:`poseppl_models.bodies.anthropometry.segment_lengths`, mm.
        axes: Axes of each joint, sides left out; those that are missing do not turn.
        cones: The parts.
    """
    tree = kinematic_tree(_joints(lengths, axes), _markers(lengths))
    rest = np.array([mirrored_angle(REST, joint, axis) for joint, axis in tree.coordinates])
    rest[2] = lengths["thigh"] * np.cos(0.1) + lengths["shank"] * np.cos(0.1) + lengths["ankle_height"]
    return ConeBody(tree, flesh_of(tree, cones), joint_limits(tree), _apart([cone.name for cone in cones]), rest)


def with_crown(body: ConeBody, height: float) -> ConeBody:
    """The body with its marker ``crown`` so high above the neck (mm): recordings put it inside of the head. Cones stay."""
    offsets = body.tree.marker_offsets.at[body.tree.marker_names.index("crown"), 2].set(height)
    return body._replace(tree=body.tree.with_offsets(body.tree.offsets, offsets))


def limb_cones(lengths: Mapping[str, float], radii: Mapping[str, tuple[float, float]], names: Sequence[str]) -> list[Cone]:
    """Cones of both sides for segments named as in :func:`poseppl_models.bodies.anthropometry.segment_radii`."""
    joints = {"upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist", "thigh": "hip", "shank": "knee", "foot": "ankle"}
    cones = []
    for name in names:
        for side in "lr":
            joint = f"{joints[name]}_{side}"
            if name == "foot":
                heel = (0.0, -0.25 * lengths["foot"], -0.5 * lengths["ankle_height"])
                cones.append(Cone(f"foot_{side}", joint, lengths["foot"], radii["foot"], origin=heel, axis=(0, 1, 0)))
            else:
                cones.append(Cone(f"{name}_{side}", joint, lengths[name], radii[name], axis=(0, 0, -1)))
    return cones


def trunk_cones(lengths: Mapping[str, float], radii: Mapping[str, tuple[float, float]]) -> list[Cone]:
    """The torso, from below the hips to the shoulders, and the head with the neck, which joins it."""
    below = 0.1 * lengths["trunk"]
    return [
        Cone("torso", "thorax", lengths["trunk"] + below, radii["torso"], (1.0, TORSO_DEPTH), origin=(0, 0, -below)),
        Cone("head", "neck", lengths["head"], radii["head"], (1.0, 1.2)),
    ]


def proportional_body(
    stature: float, known: Mapping[str, float] | None, axes: Mapping[str, str], limbs: Sequence[str]
) -> ConeBody:
    """Build the body of a person so tall (mm), its segments in proportion.

    Args:
        stature: The person's stature.
        known: Segment lengths (mm) that were measured.
        axes: Axes of each joint, as :func:`cone_body` takes them.
        limbs: Segments of the limbs that have a cone.
    """
    lengths, radii = segment_lengths(stature) | dict(known or {}), segment_radii(stature)
    return cone_body(lengths, axes, [*trunk_cones(lengths, radii), *limb_cones(lengths, radii, limbs)])


def _joints(size: Mapping[str, float], axes: Mapping[str, str]) -> list[Joint]:
    joints = [
        Joint("pelvis", None, (0, 0, 0), axes["pelvis"]),
        Joint("thorax", "pelvis", (0, 0, 0), axes.get("thorax", "")),
        Joint("neck", "thorax", (0, 0, size["trunk"]), axes.get("neck", "")),
    ]
    for side, sign in (("l", -1.0), ("r", 1.0)):
        rows = (
            ("clavicle", "thorax", (0.0, 0.0, size["trunk"])),
            ("shoulder", f"clavicle_{side}", (sign * size["shoulder_width"], 0.0, 0.0)),
            ("elbow", f"shoulder_{side}", (0.0, 0.0, -size["upper_arm"])),
            ("wrist", f"elbow_{side}", (0.0, 0.0, -size["forearm"])),
            ("hip", "pelvis", (sign * size["hip_width"], 0.0, 0.0)),
            ("knee", f"hip_{side}", (0.0, 0.0, -size["thigh"])),
            ("ankle", f"knee_{side}", (0.0, 0.0, -size["shank"])),
        )
        joints += [Joint(f"{name}_{side}", parent, offset, axes.get(name, "")) for name, parent, offset in rows]
    return joints


def _markers(size: Mapping[str, float]) -> list[Marker]:
    ends = {"hand": ("wrist", (0.0, 0.0, -size["hand"])), "toe": ("ankle", (0.0, 0.75 * size["foot"], -size["ankle_height"]))}
    limbs = [f"{name}_{side}" for side in "lr" for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")]
    return [
        *(Marker(joint, joint) for joint in ("pelvis", "neck", *limbs)),
        Marker("crown", "neck", (0, 0, size["head"])),
        *(Marker(f"{end}_{side}", f"{joint}_{side}", offset) for side in "lr" for end, (joint, offset) in ends.items()),
    ]


def _apart(names: Sequence[str]) -> Pairs:
    """Pairs of parts that do not follow each other in a limb of one side."""
    meet = neighbours_in(_CHAINS)
    pairs = ((i, j) for j in range(len(names)) for i in range(j))
    return tuple((i, j) for i, j in pairs if not meet(names[i], names[j]))


MARGIN = 0.05
"""Radians by which fitted poses keep clear of the limits, so that poses around them are possible."""
_PULLS = (20.0, 5.0)
"""Weights (mm a radian) that pull angles towards the frame before and towards rest."""
_HEADINGS = 8
_SEGMENTS = {
    "trunk": ("pelvis", "neck"),
    "head": ("neck", "crown"),
    "shoulder_width": ("neck", "shoulder"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "hip_width": ("pelvis", "hip"),
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
}


def measured_lengths(places: Mapping[str, Any]) -> dict[str, float]:
    """Mean lengths (mm) of the segments between markers, those of both sides together.

    Args:
        places: (T, 3) mm of each marker. ``head`` reaches to the marker ``crown``, which recordings put inside of the head.

    Raises:
        InputError: A marker is missing.
    """
    lengths = {}
    for segment, pair in _SEGMENTS.items():
        spans = [[place for place in (end, f"{end}_{side}") if place in places] for end in pair for side in "lr"]
        if not all(spans):
            raise InputError(f"no marker {' or '.join(pair)} on both sides", field="places", expected="the fifteen markers")
        apart = [np.asarray(places[spans[side][0]]) - np.asarray(places[spans[2 + side][0]]) for side in (0, 1)]
        lengths[segment] = float(np.nanmean(np.linalg.norm(apart, axis=-1)))
    return lengths


def fitted_stature(lengths: Mapping[str, float]) -> float:
    """Stature (mm) whose segments come closest to measured ones by least squares; the head is left out."""
    pairs = np.array([(LENGTH_SHARES[name], length) for name, length in lengths.items() if name != "head"])
    return float(pairs[:, 0] @ pairs[:, 1] / (pairs[:, 0] @ pairs[:, 0]))


def fitted_states(body: ConeBody, places: Mapping[str, Any]) -> Floats:
    """Find the poses (T, d) whose markers lie closest to given ones, within the limits, from frame to frame.

    Args:
        body: The body.
        places: (T, 3) mm of each marker, none of them missing in a frame; those that the body does not have are left out.

    Raises:
        InputError: The body has none of the markers, or one is unknown in a frame.
    """
    index = [number for number, name in enumerate(body.tree.marker_names) if name in places]
    target = (
        np.stack([np.asarray(places[body.tree.marker_names[number]], np.float64) for number in index], 1) if index else None
    )
    if target is None or not np.isfinite(target).all():
        raise InputError("markers are missing", field="places", expected="markers of the body, known in every frame")
    solve = _solver(body, np.array(index))
    root = np.array([axis in ("tx", "ty", "tz") for _, axis in body.tree.coordinates])
    heading = body.tree.coordinates.index((body.tree.joint_names[0], "Z"))
    guesses = np.tile(body.rest, (_HEADINGS, 1))
    guesses[:, root] = target[0].mean(0)
    guesses[:, heading] += 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS
    states = [min((solve(target[0], guess, body.rest) for guess in guesses), key=lambda found: found[1])[0]]
    for frame in target[1:]:
        states.append(solve(frame, states[-1], states[-1])[0])  # noqa: PERF401
    return np.array(states)


def _solver(body: ConeBody, index: NDArray[np.int_]) -> Callable[[Floats, Floats, Floats], tuple[Floats, float]]:
    """Least squares of one frame: (target, guess, frame before) to (state, cost)."""
    free = np.isinf(body.limits).all(1)
    low, high = body.limits[:, 0] + MARGIN, body.limits[:, 1] - MARGIN
    scale = np.where(free, 100.0, 0.3)

    def residuals(x: Array, target: Array, before: Array) -> Array:
        apart = marker_positions(body.tree, x)[index] - target
        to_before, to_rest = (jnp.where(free, 0.0, change) for change in (x - before, x - body.rest))
        return jnp.concatenate([apart.ravel(), _PULLS[0] * to_before, _PULLS[1] * to_rest])

    value, jacobian = jit(residuals), jit(jax.jacrev(residuals))

    def solve(target: Floats, guess: Floats, before: Floats) -> tuple[Floats, float]:
        found = scipy.optimize.least_squares(
            lambda x: np.asarray(value(x, target, before), np.float64),
            np.clip(guess, low + 1e-6, high - 1e-6),
            jac=lambda x: np.asarray(jacobian(x, target, before), np.float64),
            bounds=(low, high),
            x_scale=scale,
            ftol=1e-5,
            max_nfev=100,
        )
        return np.asarray(found.x, np.float64), float(found.cost)

    return solve
