"""Constraints of a body, as log-factors of its programs: joints have limits, and no limb, a capsule, runs through another.

They are -inf where one is broken (Darby et al. 2008, section 6.1: "zero weighting"), for particle filters.

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

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry import KinematicTree
from poseppl.motion.geometry.batch_last import batched_score
from poseppl.motion.geometry.flesh import Flesh, PartFrames, parts_of
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.bodies.joint_angles import hard_limits
from poseppl_models.images.image_program import CHUNK

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
