"""Tracking a body in images: the scene, the cameras, a start, the run, and its result."""

from poseppl.tracking.metrics import Metrics as Metrics
from poseppl.tracking.metrics import measure_run as measure_run
from poseppl.tracking.placing import place_cameras as place_cameras
from poseppl.tracking.problem import Problem as Problem
from poseppl.tracking.problem import pose_problem as pose_problem
from poseppl.tracking.problem import problem_of_result as problem_of_result
from poseppl.tracking.scene import Scene as Scene
from poseppl.tracking.scene import observe_motion as observe_motion
from poseppl.tracking.scene import scene_of_observations as scene_of_observations
from poseppl.tracking.smooth import SmoothSettings as SmoothSettings
from poseppl.tracking.smooth import smooth as smooth
from poseppl.tracking.subjects import recorded_subject as recorded_subject
from poseppl.tracking.subjects import walking_subject as walking_subject
from poseppl.tracking.track import TrackSettings as TrackSettings
from poseppl.tracking.track import TrackStopped as TrackStopped
from poseppl.tracking.track import track as track
