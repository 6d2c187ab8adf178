"""Rotations, kinematic trees and cameras: pure JAX, differentiable, batch-last inside."""

from poseppl.geometry.batch_last import batch_last as batch_last
from poseppl.geometry.cameras import Cameras as Cameras
from poseppl.geometry.cameras import depth as depth
from poseppl.geometry.cameras import join_cameras as join_cameras
from poseppl.geometry.cameras import look_at as look_at
from poseppl.geometry.cameras import paper_camera as paper_camera
from poseppl.geometry.cameras import project as project
from poseppl.geometry.kinematics import marker_positions as marker_positions
from poseppl.geometry.tree import Joint as Joint
from poseppl.geometry.tree import KinematicTree as KinematicTree
from poseppl.geometry.tree import Marker as Marker
from poseppl.geometry.tree import kinematic_tree as kinematic_tree
