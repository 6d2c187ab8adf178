"""A detector's autocorrelated errors, in place of independent ones: the problem of a result, posed with them for its smoothing.

The programs are those of ``poseppl_models.bodies.detected_points``, found by name. The body walks with velocities, whose scales
are learned first (:mod:`poseppl.motion.tracking.velocity_learning`), because autocorrelated errors and the person's own motion
may explain the same data.

A first pose that was estimated from the points is not used as the prior. Its errors are those of the points, which are
autocorrelated, so that the same information would count twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from poseppl_models.bodies.detected_points import seen_by_detector

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.body import Body, BodyInputs, LastingErrors, compile_once
from poseppl.motion.geometry.kinematic_jumps import bent_as_at_rest
from poseppl.motion.tracking.body_sizes import MeasuredLengths
from poseppl.motion.tracking.problem import Problem
from poseppl.motion.tracking.start import start_scales
from poseppl.motion.tracking.velocity_learning import with_velocities
from poseppl.motion.tracking.walk import time_steps
from poseppl.runs.run import Constant, frame_inputs
from poseppl.smoothers.base import History

SHIFT, SHIFTS_LAST = 20.0, 2.0
"""Distance of markers from a skeleton's joints, mm, and its time constant, s; our choice."""
ERROR_SHARE, ERRORS_LAST = 0.5, 0.5
"""Share of the autocorrelated errors in the variance of a detector's points, and their time constant, s, if the points do not
determine them; our choice."""
POINT_ERRORS = "point errors"
"""Attribute of a result: estimates of its points' errors."""
REST_SPREAD = 0.5
"""Standard deviation of a first pose's angles about the rest pose, radians; ours."""
ROOT_PRIOR_SCALE = 10.0
"""Standard deviation of the root's position and orientation, in units of their precision in a search."""
ROUNDED = 1.0
"""Standard deviation of a length, mm, beside what comes from the places that it was measured in; ours."""


class Lasting(NamedTuple):
    """Errors of points that last.

    Attributes:
        share: Share of the variance, more than 0 and less than 1.
        seconds: Their time constant.
    """

    share: float = ERROR_SHARE
    seconds: float = ERRORS_LAST


def lasting_of(known: Mapping[str, Any]) -> Lasting:
    """The autocorrelated errors in a result's provenance; the usual ones where it has none.

    Raises:
        InputError: It is no share or no time.
    """
    recorded = known.get(POINT_ERRORS)
    if recorded is None:
        return Lasting()
    try:
        found = Lasting(float(recorded["share"]), float(recorded["lasts"]))
    except (KeyError, TypeError, ValueError) as error:
        problem = "the result's autocorrelated errors are not numbers"
        raise InputError(problem, field=POINT_ERRORS, expected="share and lasts") from error
    if not (0 < found.share < 1 and 0 < found.seconds < np.inf):
        raise InputError(f"{found.share:g} and {found.seconds:g} s", field=POINT_ERRORS, expected="a share and a time above 0")
    return found


def with_ar1_noise(
    problem: Problem,
    frames: Integers,
    rate: float | None,
    camera_covariance: Floats | None = None,
    lengths: MeasuredLengths | None = None,
    lasting: Lasting | None = None,
) -> Problem:
    """Give a problem of points autocorrelated errors, and markers that may be beside their joints.

    Arguments and errors are those of :func:`ar1_inputs`.
    """
    inputs = ar1_inputs(problem, frames, rate, camera_covariance, lengths, lasting=lasting)
    num_lengths, tree = 0 if lengths is None else len(lengths.per_place), problem.body.tree
    seen: Any = seen_by_detector(
        tree.coordinates, len(tree.marker_names), problem.num_cameras, camera_covariance is not None, num_lengths
    )
    model = compile_once(seen.program, frame_inputs(inputs, 0))
    sizes = {"pose": seen.pose, "markers": seen.markers, "cameras": seen.cameras}
    return Problem(problem.body, model, problem.observations, inputs, **sizes, num_static=seen.num_static)


def ar1_inputs(
    problem: Problem,
    frames: Integers,
    rate: float | None,
    camera_covariance: Floats | None = None,
    lengths: MeasuredLengths | None = None,
    start: Floats | None = None,
    lasting: Lasting | None = None,
) -> BodyInputs:
    """The inputs of a body's programs with autocorrelated errors.

    Args:
        problem: The problem.
        frames: Its frames' numbers (T,).
        rate: Frames a second; 30 if None.
        camera_covariance: Covariance of the cameras' errors (6 C, 6 C), radians and mm, which are then part of the state; None
            if the cameras are assumed exact.
        lengths: How the body's lengths were measured, if in the same points; None if they are exact.
        start: Poses (T, d) from which the scales of velocities are learned; those of an extended Kalman smoother if None.
        lasting: Share of the autocorrelated errors, and their time constant, s; :data:`ERROR_SHARE` and :data:`ERRORS_LAST`
        if None.

    Raises:
        InputError: The problem is not one of points of a whole body that walks at random.
    """
    given = problem.inputs
    if not isinstance(given, BodyInputs) or given.seen is not None or problem.pose is not None:
        raise InputError(
            "autocorrelated errors are for points of a whole body", field=Argument("errors"), expected="independent"
        )
    seconds, lasting = time_steps(frames, rate), lasting or Lasting()
    own = with_velocities(problem, seconds, start)
    root = np.zeros((0, 0)) if camera_covariance is None else np.linalg.cholesky(camera_covariance)
    noise = own.noise.value if isinstance(own.noise, Constant) else own.noise
    errors = LastingErrors(
        shift_scale=Constant(jnp.asarray(SHIFT, float)),
        shift_kept=jnp.asarray(np.exp(-seconds / SHIFTS_LAST), float),
        error_share=Constant(jnp.asarray(lasting.share, float)),
        error_kept=jnp.asarray(np.exp(-seconds / lasting.seconds), float),
        length_root=Constant(jnp.asarray(_length_root(lengths, mean_deviation(seconds)), float)),
        per_length=None if lengths is None else Constant(lengths.offsets),
        camera_root=Constant(jnp.asarray(root, float)),
    )
    opened: BodyInputs = _with_open_start(own, problem.body)
    return opened._replace(noise=jnp.broadcast_to(noise, (len(frames), *noise.shape[-2:])), errors=errors)


def _with_open_start(own: Any, body: Body) -> Any:
    """The body's inputs with a first pose of which, if it was sought, no more is known than that it is a body's."""
    start, scale = (np.asarray(each.value, np.float64) for each in (own.start, own.start_scale))
    if not np.allclose(scale, start_scales(body)):
        return own
    root = np.array([joint == body.tree.coordinates[0][0] for joint, _ in body.tree.coordinates])
    mean, spread = np.where(root, start, body.rest), np.where(root, ROOT_PRIOR_SCALE * scale, REST_SPREAD)
    return own._replace(start=Constant(jnp.asarray(mean, float)), start_scale=Constant(jnp.asarray(spread, float)))


def mean_deviation(seconds: Floats) -> float:
    """Standard deviation, mm, of how far a marker is from its joint along an axis, on average over frames.

    Over a time t, of what lasts for s, the mean's variance is 2 (s / t)^2 (t / s - 1 + exp(-t / s)) of a frame's.

    Args:
        seconds: To each frame from the one before (T,).
    """
    lasts = float(seconds[1:].sum()) / SHIFTS_LAST
    return float(SHIFT * np.sqrt(2 * (lasts + np.expm1(-lasts)) / lasts**2)) if lasts > 1e-3 else SHIFT


def _length_root(lengths: MeasuredLengths | None, deviation: float) -> Floats:
    """S: errors of lengths measured in places that are all off by a deviation, mm, and by :data:`ROUNDED` each besides."""
    if lengths is None:
        return np.zeros((0, 0))
    columns = np.hstack([deviation * lengths.per_place, ROUNDED * np.eye(len(lengths.per_place))])
    return np.asarray(np.linalg.cholesky(columns @ columns.T))


def with_no_errors(history: History, problem: Problem) -> History:
    """The history of a filter that knew poses alone, as one of the problem's states: nothing is beside its place.

    Limbs are bent to the side to which people's are, for the smoother keeps to the mode that it starts in.
    """
    beside = problem.model.dimension - jnp.shape(history.particles)[-1]
    return history._replace(particles=jnp.pad(_bent(history, problem.body), ((0, 0), (0, 0), (0, beside))))


def filtered_poses(history: History, problem: Problem) -> Floats:
    """Mean poses (T, d) of a filter, with limbs bent to the side to which people's are."""
    shares = jax.nn.softmax(jnp.asarray(history.log_weights), 1)
    return np.asarray(jnp.einsum("tn,tnd->td", shares, _bent(history, problem.body)), np.float64)


def _bent(history: History, body: Body) -> Array:
    rest, particles = jnp.asarray(body.rest, float), jnp.asarray(history.particles)
    bent: Array = bent_as_at_rest(body.tree, rest, particles, jnp.asarray(history.log_weights))
    return bent
