"""Interface of a model of a body in images to an experiment: programs, inputs from pictures, and true poses.

A system is built for a person who was seen: :class:`SeenPerson` tells how they moved and what cameras saw of them at first. The
builder is a function of a :class:`SeenPerson` and settings of its own, which are numbers, flags and words; it is named by a
string, ``package.module:builder``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from jax import Array

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.io.opencv import Image
from poseppl.motion.vision import FrameFeatures
from poseppl.program import StateSpaceModel


class Sight(NamedTuple):
    """One frame as C cameras show it.

    Attributes:
        features: Features of each camera.
        images: (H, W, 3) RGB of each camera.
    """

    features: Sequence[FrameFeatures]
    images: Sequence[Image]

    def of_cameras(self, number: int) -> Sight:
        """Pictures of the first cameras."""
        return Sight(self.features[:number], self.images[:number])


class SeenPerson(NamedTuple):
    """A person of known motion before C cameras.

    Attributes:
        markers: (T, 3) mm of each of the fifteen virtual markers, by name.
        rate: Frames a second.
        cameras: C cameras, px.
        first: The first frame.
    """

    markers: Mapping[str, Floats]
    rate: float
    cameras: Cameras
    first: Sight


class LearnedMotion(NamedTuple):
    """Additions of a system whose motion is learned from recordings; inputs and states are those of its own programs.

    Attributes:
        poses: From states (N, d') and inputs to poses (N, d).
        taught: From inputs of a frame and a :class:`poseppl.motion.learned.MotionModel` to the inputs under this model; None
            where the model does not change.
        first: From inputs, the state (d',) that the first frame's walk starts from; None where nobody tells it.
    """

    poses: Callable[[Array, Any], Array]
    taught: Callable[[Any, Any], Any] | None = None
    first: Callable[[Any], Array] | None = None


class ImageSystem(NamedTuple):
    """A body, its programs, and what they take from images.

    Attributes:
        tree: The kinematic tree, in the order of the state (d,).
        program: The programs, whose inputs have ``start`` and ``start_scale`` (d,): mean and standard deviations of the first
            state.
        params: Their params.
        inputs: Inputs of a frame, from what the cameras show.
        fitted: Poses that are closest to the truth (T, d).
        limbs: Coordinates of each limb, for crossover.
        learned: Additions of a learned motion; None if states are poses and nothing is learned.
    """

    tree: KinematicTree
    program: StateSpaceModel
    params: Mapping[str, float]
    inputs: Callable[[Sight], Any]
    fitted: Floats
    limbs: Sequence[Sequence[int]] = ()
    learned: LearnedMotion | None = None


def build_system(builder: str, person: SeenPerson, settings: Mapping[str, Any]) -> ImageSystem:
    """Build a system by the name of its builder; this imports its module.

    Raises:
        InputError: There is no such builder.
    """
    build: Any = load_builder(builder)
    system: ImageSystem = build(person, **settings)
    return system
