"""Systems of papers on tracking people in video: their interface to an experiment, body, likelihood and dynamics.

Bodies have the person's stature; those of Darby and of Du and Guan the segment lengths, too (Peursum's has fixed proportions).
The first state is Gaussian around the body's pose that is closest to the first frame's truth, with the walk's own scale.
Peursum's diffusion is the published one (section 5.2), of variances a frame at 25 Hz. For the others it is half the largest
change of each coordinate between frames (Darby, section 6.2; Du and Guan do not specify it). Here it comes from the poses
closest to the truth, so the filters know how fast this person moves, but not when or where to.

The papers do not give Du and Guan's scales of colours and boundaries; they are our choice. So is the scale of Peursum's D,
whose exponent is therefore a setting.

A system is built for a person who was seen: :class:`SeenPerson` tells how they moved and what cameras saw of them at first. The
builder is a function of a :class:`SeenPerson` and settings of its own, which are numbers, flags and words; it is named by a
string, ``package.module:builder``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.io.opencv import Image
from poseppl.motion.vision import FrameFeatures
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.anthropometry import STATURE
from poseppl_models.bodies.cone_body import ConeBody, fitted_states, fitted_stature, measured_lengths, with_crown
from poseppl_models.darby.body import darby_body, darby_monocular_score, darby_score
from poseppl_models.du_guan.likelihood import du_guan_body, du_guan_score
from poseppl_models.images.evidence import colours_at, du_guan_of_features, two_way_of_features
from poseppl_models.images.image_program import CameraScore, ImageInputs, image_program, parts_apart, within_limits
from poseppl_models.peursum.body import peursum_body, peursum_score

STRIDE = 4
"""Pixels between points of the likelihoods' grids."""
BETA = 10.0
"""Inverse temperature of Darby's weight."""
VARIANCES = {"tx": 300.0, "ty": 300.0, "tz": 100.0, "Z": 6.0, "X": 8.0, "Y": 4.0}
"""Peursum's, mm^2 and square degrees: azimuth, elevation and roll are taken for turns about z, x and y."""
HEADING = 20.0
PUBLISHED_RATE = 25.0
_MIN_ANGLE, _MIN_PLACE = 0.01, 2.0
_LIMBS = (("clavicle", "shoulder", "elbow"), ("hip", "knee"))


def peursum_system(person: SeenPerson, *, views: int = 4, measured: bool = False, exponent: float = 10.0) -> ImageSystem:
    """Peursum, Venkatesh and West (2010).

    Args:
        person: Person that is seen.
        views: How many cameras are used, the first ones.
        measured: Whether the diffusion is that of the other two systems instead of the published one.
        exponent: lambda of Eq. 9.
    """
    body, fitted = peursum_person(person.markers)
    scale = half_of_largest(body, fitted) if measured else published_scale(body, person.rate)
    program = image_program(body, peursum_score(STRIDE), {"limits": within_limits})
    inputs = two_way_inputs(person, views, fitted[0], scale)
    return ImageSystem(body.tree, program, {"lambda": exponent}, inputs, fitted, limbs_of(body))


def darby_system(person: SeenPerson, *, views: int = 4, equation: int = 8) -> ImageSystem:
    """Darby, Li and Costen (2008), without the learned model.

    Args:
        person: Person that is seen.
        views: How many cameras are used, the first ones.
        equation: 8, the standard weight, or 9, that for one camera.
    """
    body, fitted, scale = measured_body(darby_body, person)
    program = image_program(body, darby_weight(equation), {"limits": within_limits, "parts": parts_apart})
    inputs = two_way_inputs(person, views, fitted[0], scale)
    return ImageSystem(body.tree, program, {"beta": BETA, "gamma": 5.0}, inputs, fitted, limbs_of(body))


def du_guan_system(
    person: SeenPerson,
    *,
    views: int = 1,
    overlap_scale: float = 1.0,
    colour_scale: float = 0.3,
    boundary_scale: float = 0.3,
) -> ImageSystem:
    """Du and Guan (2006); the colours of the parts are learned in the first frame.

    Args:
        person: Person that is seen.
        views: How many cameras are used, the first ones.
        overlap_scale: Scale of the logarithm of the overlap of silhouettes.
        colour_scale: Scale of the distance of colours.
        boundary_scale: Scale of the distance of boundaries.
    """
    body, fitted, scale = measured_body(du_guan_body, person)
    first = person.first.of_cameras(views)
    colours = colours_at(body, fitted[0], _first(person.cameras, views), first.features, first.images)

    def evidence(sight: Sight) -> Any:
        return du_guan_of_features(sight.features, sight.images, colours, stride=STRIDE)

    program = image_program(body, du_guan_score(STRIDE), {"limits": within_limits})
    params = {"overlap_scale": overlap_scale, "colour_scale": colour_scale, "boundary_scale": boundary_scale}
    return ImageSystem(body.tree, program, params, _inputs(person, views, evidence, fitted[0], scale), fitted, limbs_of(body))


def darby_weight(equation: int) -> CameraScore:
    """Darby's weight: 8, the standard one, or 9, that for one camera."""
    return darby_score() if equation == 8 else darby_monocular_score(STRIDE)


def peursum_person(markers: Mapping[str, Floats]) -> tuple[ConeBody, Floats]:
    """Peursum's body in a person's size, and its poses (T, d) closest to markers (T, 3), mm, by name."""
    lengths = measured_lengths(markers)
    body = with_crown(peursum_body(fitted_stature(lengths) / STATURE), lengths["head"])
    return body, fitted_states(body, markers)


def published_scale(body: ConeBody, rate: float) -> Floats:
    """Peursum's standard deviations (d,) of a step at so many frames a second: mm and radians."""
    root = body.tree.joint_names[0]
    variances = [HEADING if pair == (root, "Z") else VARIANCES[pair[1]] for pair in body.tree.coordinates]
    turns = np.array([len(axis) == 1 for _, axis in body.tree.coordinates])
    return np.asarray(np.sqrt(np.array(variances) * PUBLISHED_RATE / rate) * np.where(turns, np.pi / 180, 1.0))


def half_of_largest(body: ConeBody, fitted: Floats) -> Floats:
    """Half the largest change (d,) of each coordinate between frames of poses (T, d), and not less than a little."""
    least = np.where([len(axis) == 2 for _, axis in body.tree.coordinates], _MIN_PLACE, _MIN_ANGLE)
    return np.asarray(np.maximum(np.abs(np.diff(fitted, axis=0)).max(0) / 2, least))


def limbs_of(body: ConeBody) -> Sequence[Sequence[int]]:
    """Coordinates of each arm and leg."""
    joints = [joint for joint, _ in body.tree.coordinates]
    return [
        [number for number, joint in enumerate(joints) if joint[:-2] in limb and joint.endswith(f"_{side}")]
        for limb in _LIMBS
        for side in "lr"
    ]


def measured_body(build: Callable[..., ConeBody], person: SeenPerson) -> tuple[ConeBody, Floats, Floats]:
    """A body of the person's lengths, the poses closest to the truth, and half their largest changes between frames."""
    lengths = measured_lengths(person.markers)
    segments = {name: length for name, length in lengths.items() if name != "head"}
    body = with_crown(build(fitted_stature(lengths), segments), lengths["head"])
    fitted = fitted_states(body, person.markers)
    return body, fitted, half_of_largest(body, fitted)


def two_way_inputs(person: SeenPerson, views: int, start: Floats, scale: Floats) -> Callable[[Sight], ImageInputs]:
    """Inputs of likelihoods by silhouettes and edges, from the first cameras; start and scale of the walk (d,)."""
    return _inputs(person, views, lambda sight: two_way_of_features(sight.features, stride=STRIDE), start, scale)


def _inputs(
    person: SeenPerson, views: int, evidence: Callable[[Sight], Any], start: Floats, scale: Floats
) -> Callable[[Sight], ImageInputs]:
    """Inputs of a frame; a camera in which all is ignored drops out."""
    cameras, mean, spread = _first(person.cameras, views), jnp.asarray(start, float), jnp.asarray(scale, float)

    def inputs(sight: Sight) -> ImageInputs:
        seen = sight.of_cameras(views)
        usable: Any = np.array([not features.ignore.all() for features in seen.features], np.float32)
        return ImageInputs(cameras, usable, jax.tree.map(np.asarray, evidence(seen)), mean, spread, spread)

    return inputs


def _first(cameras: Cameras, number: int) -> Cameras:
    first: Cameras = jax.tree.map(lambda leaf: leaf[:number], cameras)
    return first


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
