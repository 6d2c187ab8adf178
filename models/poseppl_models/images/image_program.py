"""Programs of bodies seen in images: a Gaussian random walk, a heuristic likelihood of each camera, limits and rejections.

Images are inputs of a frame, not data sites: a heuristic likelihood is no density over images, and enters by
``numpyro.factor``. Cameras are independent given the state, so that their log-likelihoods add, each by its weight; a camera
of weight 0 drops out, whatever its images hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpyro
from jax import Array

from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.geometry.batch_last import batched_score
from poseppl.motion.geometry.coverage import outline_corners
from poseppl.motion.geometry.flesh import Flesh, PartFrames, parts_of
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.cone_body import ConeBody
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
