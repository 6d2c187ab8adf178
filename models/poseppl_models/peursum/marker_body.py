"""The 28-dimensional body of Peursum, Venkatesh and West (2010) seen as points, which its motion is learned from.

>>> body = full_body()
>>> body.tree.dimension, len(body.tree.marker_names)
(28, 15)
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl.motion.bodies.body import Body
from poseppl_models.bodies.anthropometry import STATURE, segment_lengths
from poseppl_models.bodies.cone_body import fitted_stature
from poseppl_models.darby.marker_body import seen_as_points
from poseppl_models.peursum.body import peursum_body


def full_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the body in the size of a person; its proportions are fixed.

    Args:
        lengths: Segment lengths, mm, from which its stature follows.
    """
    sizes = segment_lengths() | dict(lengths or {})
    stature = fitted_stature({name: length for name, length in sizes.items() if name != "head"})
    return seen_as_points(peursum_body(stature / STATURE), sizes)
