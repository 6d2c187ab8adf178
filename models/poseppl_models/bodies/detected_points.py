r"""A body seen by a detector of keypoints, whose errors last, and now and then are large.

Pose p_t and what is beside it:

    p_t ~ N(p_(t-1) + c (v_(t-1) + v_t), step_scale^2)             the body's walk, mean-reverting or not
    v_t ~ N(h v_(t-1), (1 - h^2) velocity_scale^2)                 its velocities, a second
    s_t ~ N(a s_(t-1), (1 - a^2) shift_scale^2)      (K, 3) mm     a marker's place beside its joint
    e_t ~ N(b e_(t-1), 1 - b^2)                      (C, K, 2)     errors that last, in units of their standard deviation
    l_t = l_0 ~ N(0, S S^T)                          (L,) mm       errors of the segment lengths
    c_t = c_0 ~ N(0, R R^T)                          (C, 6)       errors of the cameras' poses, radians and mm
    y_t = project(markers(p_t; l_t) + s_t; c_t) + r noise e_t + sqrt(1 - r^2) noise u_t,    u_t ~ Student-t, bivariate

People keep their velocity for a while: in 8 frames at 30 Hz joints of recordings go 5.5 times as far as in one, with velocities
6.1 times, and by independent steps 2.8 (studies/kept_velocities.py). Without velocities the walk is the random one.

Joints of people are no hinges, and a detector's idea of a hip is not the anatomist's: with s they may be some centimetres from
where a skeleton of fixed lengths has them. A detector errs in the same way in successive frames, as long as the picture stays
much the same; taken for independent, such errors make intervals far too narrow. Variances r^2 noise^2 and (1 - r^2) noise^2 are
stationary, so that intervals do not depend on the frame rate. Lengths that were measured in the same points have the errors l:
in two seconds places that are 20 mm beside their joints are beside them by much the same. Cameras are turned about their own
axes and moved by c. Both are left out where lengths or cameras are taken for exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.bodies.body import BodyInputs, Velocities
from poseppl.motion.geometry import Cameras, marker_positions
from poseppl.motion.likelihoods.detected_points import DetectedPoints, erring, resized
from poseppl.program import Lorentzian, StateSpaceModel
from poseppl_models.bodies.random_walk import joint_sites, mean_reverting_walk

_DRIFT = 1e-3
"""Step of what does not change, radians and mm: as good as none."""
FREEDOM = 4.0
"""Degrees of freedom of the errors that do not last; ours."""


class DetectedBody(NamedTuple):
    """The programs, and what their state says of the body.

    Attributes:
        program: The programs; their data site is ``points`` (C, K, 2).
        dimension: d; the first coordinates of a flat state are the pose, in the tree's order.
        num_lengths: L.
        num_static: How many of the last coordinates do not change: errors of segment lengths, then those of the cameras.
    """

    program: StateSpaceModel
    dimension: int
    num_lengths: int = 0
    num_static: int = 0

    def pose(self, x: Array, inputs: BodyInputs) -> Array:
        """Pose (d,) of a flat state."""
        return x[: self.dimension]

    def markers(self, x: Array, inputs: BodyInputs) -> Array:
        """Markers (K, 3) of a flat state, mm."""
        static = x[len(x) - self.num_static :]
        tree = resized(inputs.tree, inputs.errors.per_length, static[: self.num_lengths]) if self.num_lengths else inputs.tree
        joints = marker_positions(tree, self.pose(x, inputs))
        return joints + x[self.dimension : self.dimension + joints.size].reshape(joints.shape)

    def cameras(self, x: Array, inputs: BodyInputs) -> Cameras:
        """The cameras of a flat state."""
        errors = x[len(x) - self.num_static + self.num_lengths :]
        return erring(inputs.cameras, errors) if self.num_static > self.num_lengths else inputs.cameras


@lru_cache(maxsize=8)
def seen_by_detector(
    coordinates: tuple[tuple[str, str], ...],
    num_markers: int,
    num_cameras: int,
    erring_cameras: bool = False,
    num_lengths: int = 0,
) -> DetectedBody:
    """Write the programs.

    Args:
        coordinates: Joint and axis of each coordinate of the pose.
        num_markers: K.
        num_cameras: C.
        erring_cameras: Whether the cameras' poses have errors.
        num_lengths: L, how many segment lengths have errors.
    """
    spans = joint_sites(coordinates)
    first_pose, next_pose = mean_reverting_walk(spans)
    errors = (num_cameras, num_markers, 2)

    def initial(params: Any, inputs: BodyInputs) -> None:
        first_pose(params, inputs)
        numpyro.sample("shift", dist.Normal(jnp.zeros((num_markers, 3)), inputs.errors.shift_scale))
        numpyro.sample("error", dist.Normal(jnp.zeros(errors), 1.0))
        if inputs.velocities is not None:
            numpyro.sample("velocity", dist.Normal(jnp.zeros_like(inputs.velocities.scale), inputs.velocities.scale))
        if num_lengths:
            normal = dist.MultivariateNormal(jnp.zeros(num_lengths), scale_tril=inputs.errors.length_root)
            numpyro.sample("length", normal)
        if erring_cameras:
            normal = dist.MultivariateNormal(jnp.zeros(6 * num_cameras), scale_tril=inputs.errors.camera_root)
            numpyro.sample("camera_error", normal)

    def transition(params: Any, state: Mapping[str, Any], inputs: BodyInputs) -> None:
        next_pose(params, state if inputs.velocities is None else moved(state, inputs.velocities), inputs)
        numpyro.sample("shift", _stationary(state["shift"], inputs.errors.shift_kept, inputs.errors.shift_scale))
        numpyro.sample("error", _stationary(state["error"], inputs.errors.error_kept, 1.0))
        if num_lengths:
            numpyro.sample("length", dist.Normal(state["length"], _DRIFT))
        if erring_cameras:
            numpyro.sample("camera_error", dist.Normal(state["camera_error"], _DRIFT))

    def moved(state: Mapping[str, Any], velocities: Velocities) -> dict[str, Any]:
        """The state, its pose moved on by the mean of the velocities before and now."""
        before = state["velocity"]
        way = velocities.step * (before + numpyro.sample("velocity", _stationary(before, velocities.kept, velocities.scale)))
        return {**state, **{name: state[name] + way[span] for name, span in spans.items()}}

    def observation(params: Any, state: Mapping[str, Any], inputs: BodyInputs) -> None:
        share = inputs.errors.error_share
        seen = DetectedPoints(
            inputs.tree,
            inputs.cameras,
            jnp.concatenate([state[name] for name in spans]),
            state["shift"],
            state["error"],
            lasting=jnp.sqrt(share) * inputs.noise,
            # a bivariate t of scale s, density (1 + r^2 / nu s^2)^(-(nu + 2) / 2), is Lorentz's of strength nu + 2, with this
            scale=jnp.sqrt((1 - share) * FREEDOM / (FREEDOM + 2)) * inputs.noise,
            lengths=state["length"] if num_lengths else jnp.zeros(0),
            per_length=inputs.errors.per_length if num_lengths else None,
            camera_errors=state["camera_error"] if erring_cameras else jnp.zeros(0),
        )
        numpyro.sample("points", Lorentzian(seen.to_event(1), FREEDOM + 2))
        numpyro.deterministic("markers", seen.markers)

    num_static = num_lengths + (6 * num_cameras if erring_cameras else 0)
    return DetectedBody(StateSpaceModel(initial, transition, observation), len(coordinates), num_lengths, num_static)


def _stationary(previous: Array, kept: Array, scale: Any) -> dist.Normal:
    return dist.Normal(kept * previous, jnp.sqrt(1 - kept**2) * scale)
