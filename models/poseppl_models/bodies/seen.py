"""Observations of a pose: image points, or silhouettes, in any number of cameras."""

from __future__ import annotations

from typing import Any

import numpyro
from jax import Array

from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions
from poseppl.motion.likelihoods import ProjectedMarkers, Silhouettes


def see_points(params: Any, pose: Array, inputs: BodyInputs) -> None:
    """Observe the site ``points`` (C, markers, 2) of a pose (d,), whose ``markers`` (K, 3) are kept, mm."""
    numpyro.sample("points", ProjectedMarkers(inputs.tree, inputs.cameras, pose, inputs.noise))
    numpyro.deterministic("markers", marker_positions(inputs.tree, pose))


def see_silhouettes(params: Any, pose: Array, inputs: BodyInputs) -> None:
    """Observe the site ``silhouette`` (C, entries) of a pose (d,), whose ``markers`` (K, 3) are kept, mm."""
    numpyro.sample("silhouette", Silhouettes(inputs.tree, inputs.flesh, inputs.cameras, pose, inputs.seen, inputs.noise))
    numpyro.deterministic("markers", marker_positions(inputs.tree, pose))
