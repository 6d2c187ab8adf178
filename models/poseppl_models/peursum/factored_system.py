"""Peursum, Venkatesh and West (2010) with the motion model of section 3.3, learned from one recorded walk: FSHHMM-PF.

Body and likelihood are those of :func:`poseppl_models.images.image_systems.peursum_system`. The first pose is unknown: it may
be any pose of the walk, in any direction, near the point that is closest to the rays through the middles of the foregrounds.
One camera determines neither such a point, nor whether somebody comes or goes. Then the first position and heading are known,
but no rotations.

The motion is that of :mod:`poseppl_models.bodies.factored_motion`.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.motion.learned import FactoredTables, bin_angles, read_factored_motion, root_places
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.bodies.factored_motion import factored_motion, pose_of_bins
from poseppl_models.images.image_program import ImageInputs, camera_likelihood, within_limits
from poseppl_models.images.image_systems import (
    STRIDE,
    ImageSystem,
    LearnedMotion,
    SeenPerson,
    Sight,
    limbs_of,
    peursum_person,
    published_scale,
    two_way_inputs,
)
from poseppl_models.peursum.body import peursum_score

FIRST_PLACE, FIRST_TURN = 150.0, 1.8
"""Standard deviations of the first position, mm, and heading, radians: that of all directions alike."""
_MIN_SHARE = 0.01
TOLD_TURN = 0.3
"""Standard deviation of a known heading, radians."""


def peursum_factored_system(
    person: SeenPerson,
    *,
    model: str,
    views: int = 4,
    exponent: float = 8.0,
) -> ImageSystem:
    """Build it.

    Args:
        person: Person that is seen.
        model: File of the learned tables.
        views: How many cameras are used, the first ones.
        exponent: lambda of Eq. 9.

    Raises:
        InputError: The file cannot be read, its rotations are beyond the body's limits, or no two cameras see the person in the
            first frame.
    """
    body, fitted = peursum_person(person.markers)
    likelihood = camera_likelihood(body, peursum_score(STRIDE))
    motion = read_factored_motion(model).tables
    check_limits(body, motion, model)
    start, start_scale = first_place(body, person, views, fitted[0])

    def observe(params: Any, pose: Array, inputs: ImageInputs) -> None:
        numpyro.factor("images", likelihood(params, pose, inputs))
        numpyro.factor("limits", within_limits(body, pose, params))

    seen = two_way_inputs(person, views, start, published_scale(body, person.rate))

    def inputs_of(sight: Sight) -> ImageInputs:
        scale, seconds = jnp.asarray(start_scale, float), jnp.asarray(1 / person.rate, float)
        return seen(sight)._replace(start_scale=scale, activity=motion, seconds=seconds)

    program = factored_motion(body.tree.coordinates, observe)
    poses = jit(jax.vmap(pose_of_flat(body), (0, None)))
    learned = LearnedMotion(lambda states, inputs: poses(states, inputs.activity))
    return ImageSystem(body.tree, program, {"lambda": exponent}, inputs_of, fitted, limbs_of(body), learned)


def pose_of_flat(body: ConeBody) -> Any:
    """Write the pose (d,) of a flat state: phase, bins, heading, position; and of its tables."""
    pose_of, rotations = pose_of_bins(body.tree.coordinates), body.tree.dimension - 4

    def pose(state: Array, motion: FactoredTables) -> Array:
        bins, heading, position = jnp.split(state[1:], [rotations, rotations + 1])
        whole: Array = pose_of({"bins": bins, "heading": heading[0], "position": position}, motion)
        return whole

    return pose


def check_limits(body: ConeBody, motion: FactoredTables, model: str) -> None:
    """Refuse tables of a rotation that the body does not reach in any phase: no particle would be possible.

    Raises:
        InputError: There is such a rotation.
    """
    rotations = np.delete(np.arange(body.tree.dimension), root_places(body.tree.coordinates))
    entries = np.asarray(motion.entries)
    angles = np.asarray(bin_angles(np.arange(entries.shape[-1]), entries.shape[-1]))
    low, high = body.limits[rotations, :, None].swapaxes(0, 1)
    shares = np.sum(entries * ((angles >= low) & (angles <= high)), -1)
    beyond = [body.tree.coordinate_names[rotations[number]] for number in np.flatnonzero(shares.max(0) < _MIN_SHARE)]
    if beyond:
        problem = f"{', '.join(beyond)} of the learned walk {'is' if len(beyond) == 1 else 'are'} beyond the body's limits"
        raise InputError(problem, file=model, expected="tables learned from another walk")


def first_place(body: ConeBody, person: SeenPerson, views: int, first_pose: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviations (d,) of the first pose, of which position and heading are known.

    Args:
        body: The body.
        person: Person that is seen.
        views: How many cameras are used.
        first_pose: The first pose (d,), whose position and heading are taken for one camera.

    Raises:
        InputError: Fewer than two cameras see the person.
    """
    axes = [axis for _, axis in body.tree.coordinates]
    point = (
        np.asarray(first_pose)[[axes.index(axis) for axis in ("tx", "ty", "tz")]] if views == 1 else _seen_place(person, views)
    )
    start, scale = np.array(body.rest, np.float64), np.ones(body.tree.dimension)
    for axis, value in zip(("tx", "ty", "tz"), point, strict=True):
        start[axes.index(axis)], scale[axes.index(axis)] = value, FIRST_PLACE
    scale[axes.index("Z")] = FIRST_TURN
    if views == 1:
        start[axes.index("Z")], scale[axes.index("Z")] = first_pose[axes.index("Z")], TOLD_TURN
    return start, scale


def _seen_place(person: SeenPerson, views: int) -> Floats:
    """The point (3,), mm, that is closest to the rays through the middles of the first frame's foregrounds."""
    cameras = jax.tree.map(np.asarray, person.cameras)
    middles, used = [], []
    for number, features in enumerate(person.first.features[:views]):
        rows, columns = np.nonzero(features.foreground)
        if len(rows):
            used.append(number)
            middles.append((columns.min() + columns.max(), rows.min() + rows.max()))
    if len(used) < 2:
        raise InputError("the person is not seen in the first frame", field="video", expected="two cameras that see the person")
    sight = (np.array(middles) / 2 - cameras.principal[used]) / cameras.focal[used]
    rays = np.einsum("cij,ci->cj", cameras.rotation[used], np.column_stack([sight, np.ones(len(used))]))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    return np.linalg.solve(across.sum(0), np.einsum("cij,cj->i", across, cameras.centre[used]))
