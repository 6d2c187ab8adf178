"""Parts of a body that do not run through each other: the prior p_pa of Sminchisescu and Triggs (2001, section 3.2).

    f_pa = w sum over pairs of parts that do not meet at a joint, of the mean over nodes of exp(-f |f|^(p - 1)),

f being the implicit surface of the other part (:mod:`poseppl.motion.geometry.implicit_surfaces`) in units of some millimetres.
The paper gives neither p nor that unit, nor says where f is evaluated. Here p = 2, 15 mm, both parts' nodes in the other's
surface, and w = 20: flesh that touches at one node of twenty costs 1.

>>> import jax.numpy as jnp
>>> from poseppl_models.sminchisescu_body import superquadric_body
>>> body = superquadric_body()
>>> residuals = non_penetration_residuals(body.flesh.names)
>>> bool(jnp.sum(residuals(jnp.asarray(body.rest, float), body.tree, body.flesh) ** 2) < 1)
True
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry import KinematicTree
from poseppl.motion.geometry.batched_score import batched_score
from poseppl.motion.geometry.implicit_surfaces import penetration
from poseppl.motion.geometry.kinematics import frames_of
from poseppl.motion.geometry.superquadrics import Superquadrics, local_nodes, part_axes, place_in
from poseppl_models.image_program import CHUNK
from poseppl_models.sides import neighbours_in

SOFTNESS = 15.0
"""Unit of the implicit surfaces, mm."""
DECAY = 2.0
"""p."""
WEIGHT = 20.0
"""w."""
_TINY = 1e-8
_LATITUDES = np.array([-1.2, -0.55, 0.0, 0.55, 1.2])
_LONGITUDES = np.arange(4) * np.pi / 2
_CHAINS = (
    ("pelvis", "chest", "neck", "head"),
    ("neck", "upper_arm"),
    ("chest", "upper_arm", "forearm", "hand"),
    ("pelvis", "thigh", "shank", "foot"),
)
"""Parts that meet: each with the next."""

Penalty = Callable[[Array, KinematicTree, Superquadrics], Array]
"""A state (d,), the tree and the flesh to residuals, with a gradient by the state."""


def non_penetration_residuals(names: Sequence[str]) -> Penalty:
    """Write the cost as residuals (P,), one for what is inside of each part, whose squares add up to 2 f_pa.

    Args:
        names: Of the P parts; those that meet at a joint are told by them.
    """
    pairs = apart(names)
    walls = np.array([[float(wall == part) for wall, _ in pairs] for part in range(len(names))])

    def residuals(state: Array, tree: KinematicTree, flesh: Superquadrics) -> Array:
        if not pairs:
            return jnp.zeros((len(names), state.shape[-1]), state.dtype)
        axes, centres = part_axes(flesh, frames_of(tree, state))
        nodes = place_in(axes, centres, local_nodes(flesh, jnp.asarray(_LATITUDES, float), jnp.asarray(_LONGITUDES, float)))
        found = penetration(flesh, axes, centres, nodes, pairs, softness=SOFTNESS, decay=DECAY)
        inside = jnp.tensordot(jnp.asarray(walls, found.dtype), found, 1, precision="highest")
        return jnp.sqrt(2 * WEIGHT * inside + _TINY)

    return batched_score(residuals, chunk=CHUNK)


def apart(names: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Ordered pairs of parts that do not meet at a joint; those of one side are told by ``_l`` and ``_r``."""
    meet, count = neighbours_in(_CHAINS), len(names)
    return tuple((i, j) for i in range(count) for j in range(count) if i != j and not meet(names[i], names[j]))
