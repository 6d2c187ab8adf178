"""A recording of points in several cameras, smoothed at once: nobody who has all frames needs a filter.

Triangulation and inverse kinematics are where the smoother starts (:mod:`poseppl.motion.tracking.triangulated_start`). Its
model is that of autocorrelated errors (:mod:`poseppl.motion.tracking.lasting_errors`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from poseppl.diagnostics import diagnose
from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.body import body_builder, source_of_model
from poseppl.motion.settings import TrackSettings
from poseppl.motion.tracking.default_body import chosen_model
from poseppl.motion.tracking.flesh_places import with_flesh
from poseppl.motion.tracking.marker_learning import learn_markers
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.recorded_model import offsets_of_lengths
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.tracking.smooth import SmoothSettings, smooth_points
from poseppl.motion.tracking.track import (
    Tracked,
    check_settings,
    problem_of_settings,
    result_of_scene,
    usual_walk,
    versions,
    walk_params,
)
from poseppl.motion.tracking.triangulated_start import triangulated_places, triangulated_poses
from poseppl.motion.tracking.walk import time_steps


def smooth_recording(scene: Scene[PointData], settings: TrackSettings | None = None) -> Tracked:
    """Smooth a scene of points in two cameras or more, without a filter.

    Args:
        scene: The scene.
        settings: How; what is of a filter alone is not read, and ``options`` are those of the smoother ``laplace``.

    Returns:
        The problem, no run, and the smoothed result with diagnostics.

    Raises:
        InputError: A setting is out of range, there is one camera, or no frame shows a marker to two cameras.
        SmoothingError: The smoothed states are not finite.
    """
    settings = settings or TrackSettings()
    model = chosen_model(settings.model, scene.data.provenance)
    settings = replace(settings, walk=settings.walk or usual_walk(scene, settings))
    check_settings(settings)
    if settings.prior is not None or scene.body.free is not None or len(scene.camera_names) < 2:
        raise InputError(
            "without a filter only a whole body, in two cameras or more and without a prior, is smoothed",
            field=Argument("filter"),
            expected="kalman or assumed-density",
        )
    params = walk_params(scene.body, settings)
    if settings.markers == "learned":
        scene = learn_markers(scene, params)  # type: ignore[assignment]
    problem, points = problem_of_settings(scene, settings, params), np.asarray(scene.data.points, np.float64)
    places = triangulated_places(problem, points)
    if not np.isfinite(places).any():
        raise InputError("no frame shows a marker to two cameras", expected="cameras that see the same person")
    poses = triangulated_poses(scene.body, places, time_steps(scene.frames, scene.rate))
    known = scene.data.provenance
    offsets = offsets_of_lengths(scene.body, body_builder(model)) if known.get("lengths measured") is True else None
    how = SmoothSettings("laplace", settings.options, settings.seed, settings.max_draws, errors="lasting")
    run, options = smooth_points(problem, points, scene.frames, scene.rate, known, offsets, poses, how)
    optional = {
        "model": model,
        "model source": source_of_model(model),
        "settings": {**params, "walk": settings.walk, "markers": settings.markers},
        **known,
        "smoother": how.method,
        "smoother settings": options,
        "errors": how.errors,
        "smoother seed": how.seed,
        "versions": versions(),
    }
    record: dict[str, Any] = {name: value for name, value in optional.items() if value is not None}
    return Tracked(problem, None, diagnose(with_flesh(result_of_scene(scene, problem, run, record), problem)))
