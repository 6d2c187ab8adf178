"""Programs of bodies seen in images: a Gaussian random walk, a heuristic likelihood of each camera, and constraints of bodies.

Images are inputs of a frame, not data sites: a heuristic likelihood is no density over images, and enters by
``numpyro.factor``. Cameras are independent given the state, so that their log-likelihoods add, each by its weight; a camera
of weight 0 drops out, whatever its images hold.

Constraints are -inf where one is broken (Darby et al. 2008, section 6.1: "zero weighting"), for particle filters.

>>> import jax.numpy as jnp
>>> from poseppl_models.darby.body import darby_body
>>> body = darby_body()
>>> float(within_limits(body, jnp.asarray(body.rest, float), {}))
0.0

A capsule is all that lies within a radius of a segment. Two of them overlap where their segments are nearer than the sum of
their radii; the nearest points of two segments are those of Ericson, *Real-Time Collision Detection* (2005, section 5.1.9),
without branches. Capsules ``inside`` of the parts, as thin as the parts' thinnest half-axis, overlap only where the parts
do: they are for rejection. Capsules ``around`` them contain them, up to the corners of the ends, and overlap before the
parts do: they are for repulsion.

>>> ends = [jnp.array([[[0.0], [0.0], [z]], [[50.0], [0.0], [z]]]) for z in (0.0, 400.0)]
>>> clearances(Capsules(*ends, jnp.array([[20.0], [15.0]])), ((0, 1),)).tolist()
[[15.0]]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jax import Array

from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.geometry.batch_last import batched_score
from poseppl.motion.geometry.coverage import outline_corners
from poseppl.motion.geometry.flesh import Flesh, PartFrames, parts_of
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.bodies.joint_angles import hard_limits
from poseppl_models.bodies.random_walk import walking_body
from poseppl_models.images.silhouette_bits import body_bits


class SeenBody(NamedTuple):
    """A body before C cameras in N states, the batch last: leaves (..., N or 1).

    Attributes:
        flesh: Its parts' sizes.
        parts: Their positions in the world.
        cameras: The cameras, px.
        evidence: Evidence of the images that the likelihood needs.
        params: Params of the program.
    """

    flesh: Flesh
    parts: PartFrames
    cameras: Cameras
    evidence: Any
    params: Mapping[str, Array]

    def corners(self) -> Array:
        """Corners (C, P, 4, 2, N) of the parts' outlines, px."""
        return outline_corners(self.cameras, self.flesh, self.parts)

    def silhouette(self, stride: int) -> Array:
        """Silhouette of the body on a grid of ``stride`` px, within the evidence: bits in words (C, rows, words, N)."""
        rows, words = self.evidence.known.shape[1:3]
        known: Array = self.evidence.known
        return body_bits(self.cameras, self.flesh, self.parts, rows, words, stride) & known


CameraScore = Callable[[SeenBody], Array]
"""Log-likelihoods (C, N) of a body's states."""
Constraint = Callable[[ConeBody, Array, Any], Array]
"""A body, a state (d,) and the params, to a log-factor ()."""
CHUNK = 64
"""Particles at a time: what a likelihood makes of so many in three cameras stays in the cache."""


class ImageInputs(NamedTuple):
    """Inputs of one frame.

    Attributes:
        cameras: C cameras, px.
        camera_weight: Shape (C,): 1 for a camera that counts, 0 for one that drops out.
        evidence: Evidence of the images that the likelihood needs, a pytree with leaves (C, ...).
        start: Mean of the first state (d,): mm and radians.
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,).
        activity: Programs of a learned motion in place of the random walk; None for a walk.
        limits: Least and largest coordinates (d, 2), where they were learned.
        features: Those of the start (eta,), likewise.
        seconds: Between the frame before and this one (); None where no motion has velocities.
    """

    cameras: Cameras
    camera_weight: Array
    evidence: Any
    start: Array
    start_scale: Array
    step_scale: Array
    activity: Any = None
    limits: Any = None
    features: Any = None
    seconds: Any = None


def image_program(body: ConeBody, score: CameraScore, constraints: Mapping[str, Constraint] | None = None) -> StateSpaceModel:
    """Write the programs; their inputs are :class:`ImageInputs`.

    Args:
        body: The body.
        score: Log-likelihood of each camera.
        constraints: Further log-factors by name, such as joint limits.
    """
    likelihood = camera_likelihood(body, score)

    def observe(params: Any, pose: Array, inputs: ImageInputs) -> None:
        numpyro.factor("images", likelihood(params, pose, inputs))
        for name, constraint in (constraints or {}).items():
            numpyro.factor(name, constraint(body, pose, params))

    return walking_body(body.tree.coordinates, observe)


def camera_likelihood(body: ConeBody, score: CameraScore) -> Callable[[Any, Array, ImageInputs], Array]:
    """Log-likelihood () of params, a state (d,) and the inputs: the weighted sum over cameras."""

    def score_states(state: Array, tree: KinematicTree, flesh: Flesh, cameras: Cameras, evidence: Any, params: Any) -> Array:
        return score(SeenBody(flesh, parts_of(tree, flesh, state), cameras, evidence, params))

    scored = batched_score(score_states, chunk=CHUNK)

    def likelihood(params: Any, pose: Array, inputs: ImageInputs) -> Array:
        values = scored(pose, body.tree, body.flesh, inputs.cameras, inputs.evidence, jax.tree.map(jnp.asarray, params))
        weight = inputs.camera_weight
        return jnp.sum(jnp.where(weight > 0, weight * values, 0.0))

    return likelihood


ALLOWED = 10.0
"""Millimetres by which capsules inside of the parts may overlap."""


def within_limits(body: ConeBody, state: Array, params: Any) -> Array:
    """0 where the joints keep to their limits, or -inf."""
    return hard_limits(body.limits, state)


def parts_apart(body: ConeBody, state: Array, params: Any) -> Array:
    """0 where no two parts run through each other, or -inf."""

    def score(state: Array, tree: KinematicTree, flesh: Flesh) -> Array:
        inside = part_capsules(flesh, parts_of(tree, flesh, state), "inside")
        return rejected(clearances(inside, body.apart), ALLOWED)[None]

    return batched_score(score, chunk=CHUNK)(state, body.tree, body.flesh)[0]


_TINY = 1e-9


class Capsules(NamedTuple):
    """Ends of the segments (P, 3, N) and radii (P, N or 1), mm."""

    start: Array
    end: Array
    radius: Array


def part_capsules(flesh: Flesh, parts: PartFrames, kind: Literal["inside", "around"]) -> Capsules:
    """Capsules of the parts, batch last.

    Args:
        flesh: Sizes of the parts, leaves (P, ..., N or 1).
        parts: Their positions, leaves (P, ..., N).
        kind: "inside" of the parts, their ends drawn in by the radius, or "around" them.
    """
    if kind == "around":
        return Capsules(parts.base, parts.tip, jnp.max(flesh.radii, 1) * jnp.max(flesh.scales, 1))
    length = jnp.abs(flesh.lengths)
    radius = jnp.minimum(jnp.min(flesh.radii, 1) * jnp.min(flesh.scales, 1), length / 2)
    drawn_in = (radius / length)[:, None] * (parts.tip - parts.base)
    return Capsules(parts.base + drawn_in, parts.tip - drawn_in, radius)


def clearances(capsules: Capsules, pairs: Sequence[tuple[int, int]]) -> Array:
    """How far pairs of capsules are apart (K, N), mm; negative by how deep they run into each other.

    Args:
        capsules: P of them.
        pairs: K pairs of their numbers.
    """
    first, second = (np.array(side, int) for side in zip(*pairs, strict=True))
    one, other = capsules.end[first] - capsules.start[first], capsules.end[second] - capsules.start[second]
    between = capsules.start[first] - capsules.start[second]
    a, e = _dot(one, one) + _TINY, _dot(other, other) + _TINY
    b, c, f = _dot(one, other), _dot(one, between), _dot(other, between)
    across = a * e - b * b
    parallel = across <= 1e-6 * a * e
    s = jnp.where(parallel, 0.0, jnp.clip((b * f - c * e) / jnp.where(parallel, 1.0, across), 0.0, 1.0))
    free = (b * s + f) / e
    t = jnp.clip(free, 0.0, 1.0)
    s = jnp.where(free == t, s, jnp.clip((b * t - c) / a, 0.0, 1.0))
    gap = between + s[:, None] * one - t[:, None] * other
    return jnp.sqrt(_dot(gap, gap) + _TINY) - capsules.radius[first] - capsules.radius[second]


def rejected(clearance: Array, allowed: float = 0.0) -> Array:
    """Log-factor (N,): -inf where some pair (K, N) overlaps by more than allowed (mm), for flesh gives way, else 0."""
    return jnp.where(jnp.any(clearance < -allowed, 0), -jnp.inf, 0.0)


def _dot(a: Array, b: Array) -> Array:
    return jnp.sum(a * b, 1)
