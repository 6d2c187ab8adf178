"""The system of Darby, Li and Costen (2008, doi:10.1109/AFGR.2008.4813348) with what it learns from recordings.

Body and likelihood are those of :func:`poseppl_models.images.image_systems.darby_system`. The walk's standard deviations are
learned, as half of the largest change between frames (section 6.2). The limits of the joints are learned if the recordings are
of the tracked person ("known"). With ``guided`` the motion itself is learned (:mod:`poseppl_models.bodies.learned_motion`), and
angles lie on its components.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jax import Array

from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.motion.learned import MotionModel, read_motion_model
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.bodies.joint_angles import hard_limits
from poseppl_models.bodies.learned_motion import Activity, learned_motion
from poseppl_models.bodies.random_walk import walking_body
from poseppl_models.darby.body import darby_body
from poseppl_models.images.image_program import ImageInputs, camera_likelihood, parts_apart
from poseppl_models.images.image_systems import (
    BETA,
    ImageSystem,
    LearnedMotion,
    SeenPerson,
    Sight,
    darby_weight,
    limbs_of,
    measured_body,
    two_way_inputs,
)


def darby_learned_system(
    person: SeenPerson,
    *,
    model: str,
    subject: str | None = None,
    guided: bool = True,
    views: int = 2,
    equation: int = 8,
    gamma: float = 5.0,
) -> ImageSystem:
    """Build it.

    Args:
        person: Person that is seen.
        model: File of the learned motion, at as many frames a second as the person is seen.
        subject: The person, if it is one of those that the motion was learned from.
        guided: Whether the learned angles move as was learned; otherwise they walk at random as the others.
        views: How many cameras are used, the first ones.
        equation: 8, the standard weight, or 9, that for one camera.
        gamma: Exponent of Eq. 9.

    Raises:
        InputError: The model is of another body or rate.
    """
    trained = read_motion_model(model)
    body, fitted, scale = measured_body(darby_body, person)
    _check(trained, body, person.rate, model)
    likelihood = camera_likelihood(body, darby_weight(equation))

    def observe(params: Any, pose: Array, inputs: ImageInputs) -> None:
        numpyro.factor("images", likelihood(params, pose, inputs))
        numpyro.factor("limits", hard_limits(inputs.limits, pose))
        numpyro.factor("parts", parts_apart(body, pose, params))

    def taught(inputs: ImageInputs, model: MotionModel) -> ImageInputs:
        walk = jnp.asarray(model.largest_step / 2, float)
        limits = jnp.asarray(model.limits if subject else body.limits, float)
        features = jnp.asarray(model.features(fitted[0], subject), float)
        activity = Activity.of_model(model, subject)
        return inputs._replace(start_scale=walk, step_scale=walk, activity=activity, limits=limits, features=features)

    seen = two_way_inputs(person, views, fitted[0], scale)

    def inputs_of(sight: Sight) -> ImageInputs:
        return taught(seen(sight), trained)

    coordinates, params = body.tree.coordinates, {"beta": BETA, "gamma": gamma}
    if not guided:
        program, motion = walking_body(coordinates, observe), LearnedMotion(lambda x, _: x, taught, lambda x: x.start)
        return ImageSystem(body.tree, program, params, inputs_of, fitted, limbs_of(body), motion)
    program = learned_motion(coordinates, tuple(trained.learned.tolist()), observe, residual=False)
    motion, groups = _guided(trained, taught), _groups(trained)
    return ImageSystem(body.tree, program, params, inputs_of, fitted, groups, motion)


def _check(model: MotionModel, body: ConeBody, rate: float, file: str) -> None:
    if tuple(model.coordinates) != tuple(body.tree.coordinate_names):
        raise InputError(
            "the motion is of another body", file=file, expected="one that poseppl_models.darby.marker_body:full_body learned"
        )
    if abs(model.rate / rate - 1) > 1e-3:
        raise InputError(f"{model.rate:g} frames a second", file=file, expected=f"{rate:g}, as the person is seen")


def _guided(model: MotionModel, taught: Any) -> LearnedMotion:
    """States are flat: phase, features (eta,), free coordinates, as the program has its sites."""
    free, learned, count = model.free, model.learned, 1 + model.components.shape[1]
    order = jnp.asarray(np.argsort(np.concatenate([free, learned])))

    def first(inputs: ImageInputs) -> Array:
        return jnp.concatenate([jnp.zeros(1), inputs.features, inputs.start[free]])

    def pose(state: Array, activity: Activity) -> Array:
        return jnp.concatenate([state[count:], activity.angles(state[1:count])])[order]

    poses = jit(jax.vmap(pose, (0, None)))
    return LearnedMotion(lambda states, inputs: poses(states, inputs.activity), taught, first)


def _groups(model: MotionModel) -> Sequence[Sequence[int]]:
    """Blocks that stay together when two parents are crossed: phase with features, and each free joint."""
    count = 1 + model.components.shape[1]
    joints = [model.coordinates[index].rpartition(".")[0] for index in model.free]
    each = [[count + at for at, name in enumerate(joints) if name == joint] for joint in dict.fromkeys(joints)]
    return [list(range(count)), *each]
