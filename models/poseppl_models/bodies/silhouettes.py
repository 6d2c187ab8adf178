"""The 28-DOF body seen as silhouettes: a likelihood for methods that use gradients.

The state and its random walk are those of :mod:`poseppl_models.bodies.choo_fleet`; a frame's data are
:class:`poseppl.motion.likelihoods.Silhouettes`, residuals in pixels whose value is 0. It is a likelihood and no heuristic:
its exponent is 1, and its noise was chosen by the coverage of intervals in rendered scenes.
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry.flesh import flesh_of
from poseppl_models.bodies.choo_fleet import full_body as pointed_body
from poseppl_models.bodies.choo_fleet_flesh import choo_fleet_flesh
from poseppl_models.bodies.random_walk import mean_reverting_walk, walking_body
from poseppl_models.bodies.seen import see_silhouettes


def full_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the body, whose programs see silhouettes.

    Args:
        lengths: Segment lengths in mm that differ from the standard subject's.
    """
    body = pointed_body(lengths)
    flesh = flesh_of(body.tree, choo_fleet_flesh(body.lengths))
    program = walking_body(body.tree.coordinates, see_silhouettes, mean_reverting_walk)
    return body._replace(program=program, flesh=flesh)
