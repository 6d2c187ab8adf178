"""Rotations, kinematic trees and cameras: pure JAX, differentiable, batch-last inside."""

from poseppl.motion.geometry.batch_last import batch_last as batch_last
from poseppl.motion.geometry.cameras import (
    Cameras as Cameras,
    depth as depth,
    join_cameras as join_cameras,
    look_at as look_at,
    paper_camera as paper_camera,
    project as project,
)
from poseppl.motion.geometry.kinematics import marker_positions as marker_positions
from poseppl.motion.geometry.tree import (
    Joint as Joint,
    KinematicTree as KinematicTree,
    Marker as Marker,
    kinematic_tree as kinematic_tree,
)
