"""Scenes with truth: recorded motion, rendered in a room with four corner cameras and clutter, by a body of its own."""

from poseppl.rendering.noise import SensorNoise as SensorNoise
from poseppl.rendering.points import find_toes as find_toes
from poseppl.rendering.render import Stage as Stage
from poseppl.rendering.scene_files import Truth as Truth
from poseppl.rendering.scene_files import write_scene as write_scene
from poseppl.rendering.setting import Setting as Setting
from poseppl.rendering.setting import build_setting as build_setting
