"""Peursum, Venkatesh and West (2010) with the motion model of section 3.3, learned from one recorded walk: FSHHMM-PF.

Body and likelihood are those of :func:`poseppl_models.images.image_systems.peursum_system`. The first pose is unknown: it may
be any pose of the walk, in any direction, near the point that is closest to the rays through the middles of the foregrounds.
One camera determines neither such a point, nor whether somebody comes or goes. Then the first position and heading are known,
but no rotations.

doi:10.1007/s11263-009-0205-5, Eqs. 7a to 7h and 26. A phase q decides how each of D rotations x^d goes on, in B bins of a turn:

    q_t ~ C[q_(t-1)],
    x_t^d ~ A^d[q_t, x_(t-1)^d]  if e_t^d = 0,    x_t^d ~ A^d[q_t]  if e_t^d = 1.

The rotations are independent given the phase. The end flag e_t^d means that the phase has no successor of the bin, so that the
rotation enters the phase again. Eq. 26 has the previous phase in its index, which would use empty rows at the beginning of a
phase. Here the index is the phase that moves the rotation. The flag follows from (q_t, x_(t-1)), and is no site.

The first frame has q_1 ~ phi and x_1^d ~ varphi[q_1]. Heading u and position v are continuous:

    u_t ~ N(u_(t-1), s_u^2),    v_t ~ w N(v_(t-1), S_v) + (1 - w) N(v_(t-1) + dt R(u_t) m_q, S_v),

which is how Eqs. 7g and 7h are read here: a body stays where it is, or goes where it faces, with the mean velocity m of the
phase for the dt seconds since the last frame. The paper names the two weights of Eq. 7h, and gives neither their values nor the
second law. So heading and position do not depend on the frame rate. Phases and rotations do: a row of C or A is a step of one
frame at the rate of the recording, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.motion.learned import FactoredTables, bin_angles, read_factored_tables, root_places
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.bodies.random_walk import Observe
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
    motion = read_factored_tables(model)
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


def factored_motion(coordinates: Sequence[tuple[str, str]], observe: Observe) -> StateSpaceModel:
    """Write the programs of a body, sites ``phase``, ``bins``, ``heading`` () and ``position`` (3,).

    Args:
        coordinates: Joint and axis of each of the body's d coordinates; the root's position and turn about the vertical are
            continuous, the other D are in bins.
        observe: Observations of a pose (d,). Inputs have ``activity`` (:class:`FactoredTables`), and ``start``, ``start_scale``
            and ``step_scale`` (d,), mm and radians, of which position and heading are used, and ``seconds`` ().
    """
    places = np.array(root_places(coordinates))
    pose_of = pose_of_bins(coordinates)

    def initial(params: Any, inputs: Any) -> None:
        first_frame(inputs.activity)
        mean, scale = inputs.start[places], inputs.start_scale[places]
        numpyro.sample("heading", dist.Normal(mean[3], scale[3]))
        numpyro.sample("position", dist.Normal(mean[:3], scale[:3]).to_event(1))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        motion: FactoredTables = inputs.activity
        phase = next_frame(motion, state)
        scale = inputs.step_scale[places]
        heading = numpyro.sample("heading", dist.Normal(state["heading"], scale[3]))
        means = state["position"] + jnp.stack([jnp.zeros(3), turned(motion.velocities[phase] * inputs.seconds, heading)])
        ways = dist.Categorical(probs=jnp.stack([motion.stays, 1 - motion.stays]))
        numpyro.sample("position", dist.MixtureSameFamily(ways, dist.Normal(means, scale[:3]).to_event(1)))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        observe(params, pose_of(state, inputs.activity), inputs)

    return StateSpaceModel(initial, transition, observation)


def pose_of_bins(coordinates: Sequence[tuple[str, str]]) -> Any:
    """Write the pose (d,) of a state of :func:`factored_motion`, by its sites, and its tables."""
    places = root_places(coordinates)
    rotations = np.setdiff1d(np.arange(len(coordinates)), places)
    order = jnp.asarray(np.argsort(np.concatenate([places, rotations])))

    def pose(state: Any, motion: FactoredTables) -> Array:
        angles = bin_angles(state["bins"], motion.first_bins.shape[-1])
        parts = [state["position"], state["heading"][None], angles]
        return jnp.concatenate(parts)[order]

    return pose


def turned(step: Array, heading: Array) -> Array:
    """A step (3,) forwards, to the left and up, in the world; a heading of 0 faces along y."""
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    forwards, left, up = step
    return jnp.stack([-sine * forwards - cosine * left, cosine * forwards - sine * left, up])


def first_frame(motion: FactoredTables) -> None:
    """Sample ``phase`` and ``bins`` (D,) of the first frame."""
    phase = numpyro.sample("phase", dist.Categorical(probs=motion.first_phase))
    numpyro.sample("bins", dist.Categorical(probs=motion.first_bins[phase]))


def next_frame(motion: FactoredTables, state: dict[str, Any]) -> Array:
    """Sample ``phase``, which is returned, and ``bins`` (D,) after a state."""
    phase: Array = numpyro.sample("phase", dist.Categorical(probs=motion.phases[state["phase"]]))
    numpyro.sample("bins", dist.Categorical(probs=motion.successors(phase, state["bins"])))
    return phase
