"""Constraints of a body, as log-factors of its programs: its joints have limits, and no limb runs through another.

Hard ones are -inf for particle filters (Darby et al. 2008, section 6.1: "zero weighting"); smooth ones are for methods with
gradients (Sminchisescu and Triggs 2001, section 3.2, has limits and repulsion of parts). The temperature of a smooth one is
its width.

>>> import jax.numpy as jnp
>>> from poseppl_models.darby_body import darby_body
>>> body = darby_body()
>>> float(hard_constraints()["limits"](body, jnp.asarray(body.rest, float), {}))
0.0
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jax import Array

from poseppl.motion.geometry import KinematicTree
from poseppl.motion.geometry.batched_score import batched_score
from poseppl.motion.geometry.capsules import clearances, part_capsules, rejected, repelled
from poseppl.motion.geometry.flesh import Flesh, parts_of
from poseppl_models.cone_body import ConeBody
from poseppl_models.image_program import CHUNK, Constraint
from poseppl_models.joint_limits import hard_limits, smooth_limits

LIMIT_WIDTH = 0.05
"""Radians over which the smooth limits set in."""
SOFTNESS = 10.0
"""Millimetres over which the smooth repulsion sets in."""


def hard_constraints(allowed: float = 10.0) -> dict[str, Constraint]:
    """Joint limits and rejection of capsules inside of the parts that overlap by more than allowed (mm): 0 or -inf."""

    def limits(body: ConeBody, state: Array, params: Any) -> Array:
        return hard_limits(body.limits, state)

    return {"limits": limits, "parts": _between_parts(rejected, allowed)}


def smooth_constraints(width: float = LIMIT_WIDTH, softness: float = SOFTNESS) -> dict[str, Constraint]:
    """Barriers at the joint limits and repulsion of the capsules inside of the parts."""

    def limits(body: ConeBody, state: Array, params: Any) -> Array:
        return smooth_limits(body.limits, state, width)

    return {"limits": limits, "parts": _between_parts(repelled, softness)}


def _between_parts(penalty: Callable[[Array, float], Array], size: float) -> Constraint:
    """A penalty of a size on the clearances of the capsules inside of the parts."""

    def parts(body: ConeBody, state: Array, params: Any) -> Array:
        def score(state: Array, tree: KinematicTree, flesh: Flesh) -> Array:
            inside = part_capsules(flesh, parts_of(tree, flesh, state), "inside")
            return penalty(clearances(inside, body.apart), size)[None]

        return batched_score(score, chunk=CHUNK)(state, body.tree, body.flesh)[0]

    return parts
