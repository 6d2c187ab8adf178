"""Tracking a body in images: the scene, the cameras, a start, the run, and its result."""

from poseppl.motion.settings import TrackSettings as TrackSettings
from poseppl.motion.tracking.export import export as export
from poseppl.motion.tracking.metrics import Metrics as Metrics, measure_run as measure_run
from poseppl.motion.tracking.observations import (
    observe_motion as observe_motion,
    scene_of_observations as scene_of_observations,
)
from poseppl.motion.tracking.problem import (
    Problem as Problem,
    make_problem as make_problem,
    problem_of_result as problem_of_result,
)
from poseppl.motion.tracking.scene import Scene as Scene
from poseppl.motion.tracking.smooth import SmoothSettings as SmoothSettings, smooth as smooth
from poseppl.motion.tracking.smoothed_recording import smooth_recording as smooth_recording
from poseppl.motion.tracking.track import Tracked as Tracked, TrackStopped as TrackStopped, track as track
