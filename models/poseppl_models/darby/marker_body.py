"""The ten-cone body of Darby, Li and Costen (2008) seen as points: 31 coordinates that walk at random, as NumPyro programs.

The body of :mod:`poseppl_models.darby.body` with the markers that its joints move: hands and feet do not turn on it, and
have none. The pelvis is the middle of the hips and the neck that of the shoulders, as the virtual markers of papers on body
tracking are (:mod:`poseppl.motion.tracking.marker_errors`).

>>> body = full_body()
>>> body.tree.dimension, len(body.tree.marker_names), body.program is full_body({"thigh": 400.0}).program
(31, 15, True)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from poseppl.errors import InputError
from poseppl.motion.bodies.body import Body
from poseppl_models.bodies.anthropometry import STATURE, segment_lengths
from poseppl_models.bodies.choo_fleet import LIMBS, NOISE, WALK
from poseppl_models.bodies.cone_body import ConeBody, fitted_stature, measured_lengths
from poseppl_models.bodies.joint_names import ALIASES, edges_along, segments
from poseppl_models.bodies.random_walk import see_points, walking_body
from poseppl_models.darby.body import darby_body

EDGES = edges_along(("pelvis", "neck", "crown"), LIMBS)


_MIDDLES = {"pelvis": "hip", "neck": "shoulder"}


def _middle(joint: str) -> tuple[str, ...]:
    """Names of the middle of a joint's two sides."""
    return tuple(f"{left}+{right}" for left, right in zip(ALIASES[f"{joint}_l"], ALIASES[f"{joint}_r"], strict=True))


_ALIASES = {**ALIASES, **{marker: _middle(joint) for marker, joint in _MIDDLES.items()}}


def full_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the body.

    Args:
        lengths: Segment lengths in mm that differ from those of :func:`poseppl_models.bodies.anthropometry.segment_lengths`.
    """
    sizes = segment_lengths() | dict(lengths or {})
    return seen_as_points(darby_body(STATURE, sizes), sizes)


def seen_as_points(cones: ConeBody, sizes: Mapping[str, float]) -> Body:
    """A body of cones whose joints are seen as points, with the lengths (mm) that it was built with."""
    tree = cones.tree.with_markers([name for name in cones.tree.marker_names if name in _ALIASES])
    program = walking_body(tree.coordinates, see_points)
    aliases = {name: _ALIASES[name] for name in tree.marker_names}
    lengths, turned = dict(sizes), segments("thorax")
    return Body(program, tree, EDGES, "pelvis", aliases, lengths, measure, None, cones.rest, WALK, NOISE, segments=turned)


def measure(markers: Mapping[str, Any]) -> dict[str, float]:
    """Measure a subject's segment lengths (mm); hands and feet, which have no markers, are those of its stature.

    Args:
        markers: Positions (T, 3) in mm by marker name, NaN where unseen.

    Raises:
        ValueError: One of the fifteen markers is never seen.
    """
    seen = {name: np.asarray(place, float) for name, place in markers.items() if np.isfinite(place).all(-1).any()}
    try:
        lengths = measured_lengths(seen)
    except InputError as error:
        raise ValueError(str(error)) from error
    return segment_lengths(fitted_stature(lengths)) | lengths
