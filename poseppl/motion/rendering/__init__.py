"""Scenes with truth: recorded motion, rendered in a room with four corner cameras and clutter, by a body of its own."""

from poseppl.motion.rendering.figure import find_toes as find_toes
from poseppl.motion.rendering.render import SensorNoise as SensorNoise, Stage as Stage
from poseppl.motion.rendering.scene_files import Truth as Truth, write_scene as write_scene
from poseppl.motion.rendering.setting import Setting as Setting, build_setting as build_setting
