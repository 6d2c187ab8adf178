"""Whom to track where the truth is known: the built-in walk, straight or along a circle, or a recorded person.

For a circle each frame is moved as a whole: it is turned about the vertical and shifted, so that poses relative to the pelvis
do not change. Let d be the direction of the walk, n the direction at a right angle to its left, and p(t) the pelvis on the
floor. Its progress along d, a(t), is smoothed over a second, so that the turn does not shake with the steps:

    q(t)  = mean of p + a(t) d                           the straight line,
    s(t)  = a(t) - a(0),    theta(t) = s(t) / R          arc length, and heading,
    q'(t) = q(0) + R sin theta d + R (1 - cos theta) n   the circle, to the left where R is positive,
    x'(t) = q'(t) + Turn(theta(t)) (x(t) - q(t))         every point x of the frame.

Sway of the pelvis to the side of the line becomes sway to the side of the circle. A foot on the floor turns with the body,
which is not realistic: its sliding speed is the body's turning rate times its distance from q.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import scipy
from poseppl_models.bodies.gait import walk

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, brief
from poseppl.motion.bodies.body import body_builder
from poseppl.motion.bodies.subject import MovingSubject, fit_subject, match_markers
from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.io import FrameRange, Motion, read_cameras, read_motion, read_names, slice_frames
from poseppl.motion.recordings.settings import CAMERAS, DISTANCE, VIEW, RecordingSettings
from poseppl.motion.tracking.body_sizes import read_lengths
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.placing import camera_names, cameras_around, cameras_of_records

WALK_FRAMES = 60
WALK_RATE = 30.0
LONGEST_WALK = 100_000
_TURNED_SECONDS = 2.0
"""Shortest stretch of the walk whose direction lays it along a circle, however few frames are asked for."""


def walking_subject(
    model: str = DEFAULT_MODEL, *, frames: str | None = None, rate: float | None = None, turn: float | None = None
) -> MovingSubject:
    """Let a body walk the built-in gait.

    Args:
        model: Its builder, ``package.module:builder``.
        frames: Range "start:stop:step" of the walk; the first 60 frames if None.
        rate: Frames a second, 30 by default.
        turn: Radius (mm) of a circle that is walked along, positive to the left; straight on if None.

    Raises:
        InputError: The model is not found, or is no body that the walk fits, or the circle is too small.
    """
    rate = WALK_RATE if rate is None else rate
    if not 0 < rate <= 10_000:
        raise InputError(f"{rate:g} frames a second", field=Argument("rate"), expected="above 0, at most 10000")
    chosen = FrameRange.parse(frames)
    stop = chosen.stop or max(WALK_FRAMES, chosen.start + 1)
    if stop > LONGEST_WALK:
        raise InputError(
            f"{brief(frames)} is out of range", field=Argument("frames"), expected=f"at most {LONGEST_WALK} frames of the walk"
        )
    length = stop if turn is None else max(stop, ceil(_TURNED_SECONDS * rate))
    gait = walk(rate, length)
    build = body_builder(model)
    states, standard = np.asarray(gait.states, np.float64), build(None)
    if states.shape[1] != standard.tree.dimension or set(gait.lengths) != set(standard.lengths):
        problem = f"the built-in walk has {states.shape[1]} coordinates and lengths of its own, which {model} does not share"
        raise InputError(problem, field=Argument("model"), expected="a body of the walk's coordinates, or a recording to track")
    body = build(dict(gait.lengths))
    markers = body.places(states)
    if turn is not None:
        bend = bend_along_circle(markers[:, body.tree.marker_names.index(body.root)], rate, turn)
        states, markers = bend.states(body.tree, states)[:stop], bend.places(markers)[:stop]
    whole = Motion(body.tree.marker_names, markers, (), rate, "built-in walk")
    part, index = slice_frames(whole, chosen), np.arange(stop)[chosen.within(stop)]
    return MovingSubject(body, states[index], part.positions, None, index, part.rate, "built-in walk")


def recorded_subject(
    path: FilePath, skeleton: FilePath | None = None, *, turn: float | None = None, **settings: Any
) -> MovingSubject:
    """Read a recording, measure its person's limbs, and find the states of the body by inverse kinematics.

    Args:
        path: A .amc, .bvh, .c3d or .trc file, or a .txt motion of DeepMimic or of exponential maps.
        skeleton: The .asf file of an .amc file, the character file of a DeepMimic motion, the .json file of exponential maps.
        turn: Radius (mm) of a circle that the chosen frames are laid along, as :func:`turned` does; as recorded if None.
        **settings: Others of :class:`~poseppl.motion.recordings.settings.RecordingSettings`: the model, frames, names, lengths,
            and the rate, the scale and the axis that is up where the format does not tell.

    Raises:
        InputError: A file, the range or the model cannot be used, or the motion cannot be laid along the circle.
    """
    return subject_of(RecordingSettings(path, skeleton, **settings), turn)


def subject_of(settings: RecordingSettings, turn: float | None = None) -> MovingSubject:
    """The recorded subject that settings name, or the one that walks the built-in gait.

    Args:
        settings: Whose motion.
        turn: Radius (mm) of a circle that is walked along; as recorded if None.

    Raises:
        InputError: A file, the range or the model cannot be used, or the motion cannot be laid along the circle.
    """
    model = settings.model or DEFAULT_MODEL
    if settings.recording is None:
        return walking_subject(model, turn=turn, frames=settings.frames, rate=settings.rate)
    path = settings.recording
    build = body_builder(model)
    whole = read_motion(path, settings.skeleton, rate=settings.rate, scale=settings.scale, up=settings.up)
    motion = chosen_motion(whole, model, settings.frames, settings.names, turn)
    chosen, count = FrameRange.parse(settings.frames), len(whole.positions)
    if not np.isfinite(motion.positions).all(-1).any():
        raise InputError("no point is seen in the chosen frames", file=motion.source, field=Argument("frames"))
    given = None if settings.names is None else read_names(settings.names)
    known = None if settings.lengths is None else read_lengths(settings.lengths, model)
    subject = fit_subject(motion, build, known, given)
    return subject._replace(frames=np.arange(count)[chosen.within(count)], source=str(path))


def cameras_of(settings: RecordingSettings, subject: MovingSubject) -> tuple[Cameras, tuple[str, ...]]:
    """Cameras that see a subject and their names: from a file, or placed around the subject.

    Raises:
        InputError: The file cannot be used, or the subject is never seen.
    """
    if settings.camera is not None:
        records = read_cameras(settings.camera)
        return cameras_of_records(records), tuple(record.name for record in records)
    count, distance, view = (
        usual if given is None else given
        for given, usual in ((settings.cameras, CAMERAS), (settings.camera_distance, DISTANCE), (settings.view, VIEW))
    )
    return cameras_around(subject, distance=distance, count=int(count), view=view), camera_names(int(count))


def chosen_motion(
    whole: Motion, model: str, frames: str | None = None, names: FilePath | None = None, turn: float | None = None
) -> Motion:
    """Take frames of a motion, and lay them along a circle if one is asked for, before any in between are left out.

    Args:
        whole: The motion.
        model: As :func:`recorded_subject` takes it, and likewise the others.
        frames: Range "start:stop:step"; all if None.
        names: Which points are which markers.
        turn: Radius of the circle, mm; as recorded if None.

    Raises:
        InputError: As :func:`recorded_subject`.
    """
    chosen = FrameRange.parse(frames)
    if turn is None:
        return slice_frames(whole, chosen)
    span = slice_frames(whole, chosen._replace(step=1))
    return slice_frames(turned(span, turn, model, names), FrameRange(step=chosen.step))


def turned(motion: Motion, radius: float, model: str = DEFAULT_MODEL, names: FilePath | None = None) -> Motion:
    """Lay a walk along a circle on the floor (`poseppl.motion.recordings.subjects`).

    Args:
        motion: The walk.
        radius: Radius of the circle, mm; positive turns left.
        model: Builder of the body whose root, a marker, is found among the motion's points.
        names: Which points are which markers, where the names are unusual.

    Raises:
        InputError: The radius is too small, the motion goes nowhere, or it lacks the root.
    """
    body = body_builder(model)(None)
    given = None if names is None else read_names(names)
    markers = match_markers(motion, body.tree.marker_names, body.aliases, given)
    return bend_motion(motion, markers[:, body.tree.marker_names.index(body.root)], radius)


MIN_RADIUS = 300.0
"""Smallest radius of a circle, mm."""
MIN_WAY = 500.0
"""Shortest distance that a walk covers in its direction, mm."""
SMOOTHED = 1.0
"""Seconds over which progress is smoothed, about a cycle of a walk."""


class Bend(NamedTuple):
    """How T frames are moved on the floor.

    Attributes:
        angles: Turn about the vertical, radians, counter-clockwise from above (T,).
        before: Points on the straight line (T, 2), mm.
        after: Their positions on the circle (T, 2), mm.
    """

    angles: Floats
    before: Floats
    after: Floats

    def places(self, places: Floats) -> Floats:
        """Move places (T, ..., 3) in mm."""
        shape = (-1,) + (1,) * (places.ndim - 2)
        cosine, sine = (f(self.angles).reshape(shape) for f in (np.cos, np.sin))
        x, y = (places[..., axis] - self.before[:, axis].reshape(shape) for axis in (0, 1))
        moved = [cosine * x - sine * y, sine * x + cosine * y]
        floor = [moved[axis] + self.after[:, axis].reshape(shape) for axis in (0, 1)]
        return np.stack([*floor, places[..., 2]], axis=-1)

    def states(self, tree: KinematicTree, states: Floats) -> Floats:
        """Move states (T, d) of a body.

        Raises:
            InputError: The root's first angle is not about the vertical.
        """
        root, axis = tree.coordinates[3]
        if (root, axis) != (tree.joint_names[0], "Z"):
            problem = f"the body's first angle is {root}.{axis}, and so it cannot be turned"
            raise InputError(problem, field=Argument("turn"), expected="a body whose root turns about Z first")
        moved = states.copy()
        moved[:, :3] = self.places(states[:, :3])
        moved[:, 3] += self.angles
        return moved


def bend_along_circle(pelvis: Floats, rate: float, radius: float) -> Bend:
    """Find how the frames of a straight walk are moved so that it follows a circle.

    Args:
        pelvis: Its places (T, 2) or (T, 3) in mm; NaN where unknown.
        rate: Frames a second.
        radius: Radius of the circle, mm: positive turns left, negative right; infinite goes straight on.

    Returns:
        The moves; the first frame stays where it is.

    Raises:
        InputError: The radius is too small, or the walk goes nowhere.
    """
    if not abs(radius) >= MIN_RADIUS:
        expected = f"at least {MIN_RADIUS:g} mm, or -{MIN_RADIUS:g} and below to turn right"
        raise InputError(f"a radius of {radius:g} mm", field=Argument("turn"), expected=expected)
    path = _complete(np.asarray(pelvis, np.float64)[:, :2])
    centre, ahead = path.mean(0), _direction(path)
    along = _smoothed((path - centre) @ ahead, rate)
    way = along - along[0]
    if not way[-1] >= MIN_WAY:
        expected = f"a walk of at least {MIN_WAY:g} mm in one direction"
        raise InputError(f"the motion goes {max(way[-1], 0.0):.0f} mm ahead", field=Argument("turn"), expected=expected)
    angles, left = way / radius, np.array([-ahead[1], ahead[0]])
    before = centre + along[:, None] * ahead
    # R sin theta and R (1 - cos theta), which hold for an infinite radius, too
    forward = way * np.sinc(angles / np.pi)
    sideways = way * np.sinc(angles / (2 * np.pi)) * np.sin(angles / 2)
    return Bend(angles, before, before[0] + forward[:, None] * ahead + sideways[:, None] * left)


def bend_motion(motion: Motion, pelvis: Floats, radius: float) -> Motion:
    """Lay a recorded walk along a circle.

    Args:
        motion: The walk, Z up.
        pelvis: As :func:`bend_along_circle` takes it.
        radius: Likewise.

    Raises:
        InputError: As :func:`bend_along_circle`.
    """
    return replace(motion, positions=bend_along_circle(pelvis, motion.rate, radius).places(motion.positions))


def _complete(path: Floats) -> Floats:
    """A path (T, 2) whose unknown places lie between those before and after."""
    known, frames = np.isfinite(path).all(-1), np.arange(len(path))
    if not known.any():
        raise InputError("the pelvis is not known in any frame", field=Argument("turn"), expected="a motion that has it")
    return np.stack([np.interp(frames, frames[known], path[known, axis]) for axis in (0, 1)], axis=-1)


def _direction(path: Floats) -> Floats:
    """Unit vector (2,) of the mean velocity, by least squares; x where there is none."""
    times = np.arange(len(path)) - (len(path) - 1) / 2
    velocity = times @ path
    length = np.linalg.norm(velocity)
    return np.asarray(velocity / length if length > 0 else [1.0, 0.0])


def _smoothed(values: Floats, rate: float) -> Floats:
    """Values (T,) by straight lines fitted around each frame."""
    window = min(round(rate * SMOOTHED), len(values))
    window -= 1 - window % 2
    return values if window < 3 else np.asarray(scipy.signal.savgol_filter(values, window, 1))
