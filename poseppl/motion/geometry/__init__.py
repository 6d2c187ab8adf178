"""Rotations, kinematic trees and cameras: pure JAX, differentiable, batch-last inside."""

from poseppl.motion.geometry.batch_last import batch_last as batch_last
from poseppl.motion.geometry.cameras import Cameras as Cameras
from poseppl.motion.geometry.cameras import depth as depth
from poseppl.motion.geometry.cameras import join_cameras as join_cameras
from poseppl.motion.geometry.cameras import look_at as look_at
from poseppl.motion.geometry.cameras import paper_camera as paper_camera
from poseppl.motion.geometry.cameras import project as project
from poseppl.motion.geometry.kinematics import marker_positions as marker_positions
from poseppl.motion.geometry.tree import Joint as Joint
from poseppl.motion.geometry.tree import KinematicTree as KinematicTree
from poseppl.motion.geometry.tree import Marker as Marker
from poseppl.motion.geometry.tree import kinematic_tree as kinematic_tree
