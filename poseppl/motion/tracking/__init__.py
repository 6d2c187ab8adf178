"""Tracking a body in images: the scene, the cameras, a start, the run, and its result."""

from poseppl.motion.tracking.metrics import Metrics as Metrics
from poseppl.motion.tracking.metrics import measure_run as measure_run
from poseppl.motion.tracking.placing import place_cameras as place_cameras
from poseppl.motion.tracking.problem import Problem as Problem
from poseppl.motion.tracking.problem import make_problem as make_problem
from poseppl.motion.tracking.problem import problem_of_result as problem_of_result
from poseppl.motion.tracking.scene import Scene as Scene
from poseppl.motion.tracking.scene import observe_motion as observe_motion
from poseppl.motion.tracking.scene import scene_of_observations as scene_of_observations
from poseppl.motion.tracking.smooth import SmoothSettings as SmoothSettings
from poseppl.motion.tracking.smooth import smooth as smooth
from poseppl.motion.tracking.subjects import recorded_subject as recorded_subject
from poseppl.motion.tracking.subjects import walking_subject as walking_subject
from poseppl.motion.tracking.track import TrackSettings as TrackSettings
from poseppl.motion.tracking.track import TrackStopped as TrackStopped
from poseppl.motion.tracking.track import track as track
