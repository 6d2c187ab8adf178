"""Constraints of a body, as log-factors of its programs: its joints have limits, and no limb runs through another.

They are -inf where one is broken (Darby et al. 2008, section 6.1: "zero weighting"), for particle filters.

>>> import jax.numpy as jnp
>>> from poseppl_models.darby.cone_body import darby_body
>>> body = darby_body()
>>> float(within_limits(body, jnp.asarray(body.rest, float), {}))
0.0
"""

from __future__ import annotations

from typing import Any

from jax import Array

from poseppl.motion.geometry import KinematicTree
from poseppl.motion.geometry.batched_score import batched_score
from poseppl.motion.geometry.flesh import Flesh, parts_of
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.bodies.joint_limits import hard_limits
from poseppl_models.images.capsules import clearances, part_capsules, rejected
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
