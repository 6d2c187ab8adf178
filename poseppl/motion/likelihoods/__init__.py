"""Observation distributions that evaluate a whole body in one pass: image points and silhouettes."""

from __future__ import annotations

from poseppl.motion.likelihoods.detected_points import DetectedPoints as DetectedPoints
from poseppl.motion.likelihoods.projected_markers import (
    ProjectedMarkers as ProjectedMarkers,
    projected_log_density as projected_log_density,
)
from poseppl.motion.likelihoods.silhouettes import Silhouettes as Silhouettes, SilhouetteSeen as SilhouetteSeen
