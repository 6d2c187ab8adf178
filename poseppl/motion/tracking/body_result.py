"""Results of people and animals in cameras: what the toolkit's :mod:`poseppl.runs.results` has besides for them.

===================  =========================================================================================================
group                variables
===================  =========================================================================================================
``posterior``        ``markers`` (chain, draw, frame, marker, axis) in mm, and their projections ``points`` (chain, draw, frame,
                     camera, marker, xy); ``summary`` has moments of ``markers``
``observed_data``    ``points`` (frame, camera, marker, xy); NaN where a marker was not seen
``faults``           ``clutter`` (frame, camera, marker), that a point is anything else; ``swaps`` (frame, camera, limbs), that
                     left and right limbs are exchanged; ``wrong_person`` (frame, camera), that what was taken for the person
                     is somebody else
``truth``            ``state`` (frame, state_dim) and ``markers`` (frame, marker, axis) in mm
``camera``           the calibration, one row a camera
``body``             ``edges`` (edge, end), the pairs of markers between which a skeleton is drawn
``flesh``            of bodies with flesh: where its parts are at the mean states, see
                     :func:`poseppl.motion.tracking.flesh_places.with_flesh`
``inputs``           noise, the start, clamped states, and ``step_scale`` (frame, state_dim), the standard deviations of the
                     random
                     walk's step to each frame, mm and radians; ``marker_offsets`` (marker, axis), the markers' places in the
                     frames of their joints, mm
===================  =========================================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.runs.labels import Names, labelled
from poseppl.runs.results import build_result, draw_moments

_DIMS = {
    "markers": ("marker", "axis"),
    "points": ("camera", "marker", "xy"),
    "confidence": ("camera", "marker"),
    "clutter": ("camera", "marker"),
    "overlap": ("camera",),
    "wrong_person": ("camera",),
    "swaps": ("camera", "limbs"),
    "silhouette_area": ("camera",),
    "silhouette_centre": ("camera", "xy"),
    "step_scale": ("frame", "state_dim"),
    "marker_offsets": ("marker", "axis"),
}


class BodyNames(NamedTuple):
    """Names of the free coordinates, the markers and the cameras; nameless if left empty."""

    state_dim: Sequence[str]
    marker: Sequence[str] = ()
    camera: Sequence[str] = ()


def body_result(
    *,
    names: BodyNames,
    extras: Mapping[str, ArrayLike] | None = None,
    summary: Mapping[str, ArrayLike] | None = None,
    cameras: Mapping[str, ArrayLike | None] | None = None,
    edges: ArrayLike = (),
    root: str | None = None,
    **parts: Any,
) -> xr.DataTree:
    """Assemble the result of tracking.

    Args:
        names: Names of the coordinates.
        extras: Draws of ``markers`` and ``points``.
        summary: Moments; those of ``markers`` are computed from the draws if absent.
        cameras: Arrays with a leading axis of cameras, e.g. ``rotation``, ``centre`` (mm), ``focal``, ``principal``.
        edges: (edge, 2) indices into the markers.
        root: The marker that relative errors are measured from.
        **parts: Others of :func:`poseppl.runs.results.build_result`.

    Raises:
        ValueError: A shape does not agree with the names.
    """
    along = {"marker": names.marker, "camera": names.camera, "axis": "xyz", "xy": "xy"}
    moments = dict(summary or {})
    if extras and "markers" in extras and "markers_mean" not in moments:
        moments |= draw_moments("markers", extras["markers"])
    skeleton = {"edges": (("edge", "end"), np.asarray(edges, np.int32).reshape(-1, 2))}
    groups = {"body": xr.Dataset(skeleton, attrs={"root": root} if root else {})}
    lenses = {name: values for name, values in (cameras or {}).items() if values is not None}
    if lenses:
        numbered = xr.Coordinates({"camera": np.array(names.camera, str)} if names.camera else {})
        groups["camera"] = labelled(lenses, ("camera",), numbered)
    return build_result(
        names=Names(names.state_dim, along={dim: list(given) for dim, given in along.items()}, dims=_DIMS),
        extras=extras,
        summary=moments,
        others=groups,
        **parts,
    )
