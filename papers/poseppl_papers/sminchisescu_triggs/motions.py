"""Motions with truth: an arm that bends, a body that pivots, complex motions, and limbs that swing along the optical axis.

The paper's own sequences (section 5) are 8 s of an arm, 1.2 s of a pivoting body and 4 s of a body that turns. Ours are smooth
programs of the joints, different for every seed, and recorded motions. Angles are those of
``poseppl_models.sminchisescu_triggs.programs``.

A limb in the image plane leaves it towards the camera or away from it, and looks the same (section 1.2 of the paper). Each
motion here takes limbs through such a pose, and on to one whose mirror image breaks a joint limit or runs through the trunk: a
tracker that keeps both can find out. The camera looks along the horizontal direction in which hands and feet move most.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.geometry import marker_positions
from poseppl.motion.io import read_motion
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl_papers.recordings import Recording

_BODY = "poseppl_models.sminchisescu_triggs.body:superquadric_body"
BEGIN = 2.0
"""Second of a recording at which its first motion begins."""


class Moving(NamedTuple):
    """A body in motion.

    Attributes:
        body: The superquadric body of ``poseppl_models.sminchisescu_triggs.body``, of the person's sizes.
        states: True states (T, d); of a recording those closest to it.
        markers: True places of the markers (T, K, 3), mm.
    """

    body: Any
    states: Floats
    markers: Floats


def arm(body: Any, times: Floats, rng: np.random.Generator) -> Floats:
    """States (T, 8) of an arm that bends and rotates."""
    return _swung(
        body,
        times,
        rng,
        {
            ("shoulder_r", "Z"): (0.0, 0.5),
            ("shoulder_r", "Y"): (-0.45, 0.35),
            ("shoulder_r", "X"): (0.7, 0.6),
            ("elbow_r", "X"): (1.1, 0.8),
            ("elbow_r", "Z"): (0.0, 0.5),
        },
        (0.15, 0.35),
    )


def pivot(body: Any, times: Floats, rng: np.random.Generator) -> Floats:
    """States (T, 30) of a body that turns by a right angle and a half in 1.2 s, arms in motion."""
    states = _swung(body, times, rng, _ARMS, (0.4, 0.7))
    turn = _smooth_step(times / 1.2) * rng.choice([-1.0, 1.0]) * rng.uniform(1.2, 1.8)
    _add(body, states, {("pelvis", "Z"): turn, ("thorax", "Z"): 0.3 * np.sin(np.pi * np.clip(times / 1.2, 0, 1))})
    return states


def turns(body: Any, times: Floats, rng: np.random.Generator) -> Floats:
    """States (T, 34) of a body that turns one way and back, bends its knees and reaches out."""
    states = _swung(body, times, rng, {**_ARMS, **_LEGS}, (0.25, 0.45))
    turn = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 1.6) * np.sin(2 * np.pi * times / 4.0)
    _add(body, states, {("pelvis", "Z"): turn, ("thorax", "Z"): 0.3 * turn})
    return states


_ARMS = {
    key: value
    for side, sign in (("l", 1.0), ("r", -1.0))
    for key, value in {
        (f"shoulder_{side}", "Z"): (0.0, 0.3),
        (f"shoulder_{side}", "Y"): (0.3 * sign, 0.25),
        (f"shoulder_{side}", "X"): (0.5, 0.5),
        (f"elbow_{side}", "X"): (0.9, 0.6),
    }.items()
}
_LEGS = {
    key: value
    for side in "lr"
    for key, value in {(f"hip_{side}", "X"): (0.4, 0.3), (f"knee_{side}", "X"): (-0.5, 0.35)}.items()
}
Keys = Mapping[tuple[str, str], tuple[float, float, float, float]]


_ENDS = ("wrist_l", "wrist_r", "ankle_l", "ankle_r")


_BOTH = {"l": 1.0, "r": -1.0}
"""Sides, and the signs of turns about Y and Z."""


def _both(joint: str, axis: str, *angles: float) -> Keys:
    """The same angles of both sides, mirrored about Y and Z."""
    return {
        (f"{joint}_{side}", axis): tuple(angle * (1.0 if axis == "X" else sign) for angle in angles)  # type: ignore[misc]
        for side, sign in _BOTH.items()
    }


MOTIONS: Mapping[str, Keys] = {
    "reach": {("shoulder_r", "X"): (-0.7, 0.2, 1.4, 1.5), ("elbow_r", "X"): (0.4, 0.2, 0.1, 0.6)},
    "raise both arms": {**_both("shoulder", "X", -0.6, 0.6, 1.5, 2.2), **_both("elbow", "X", 0.5, 0.3, 0.2, 0.3)},
    "step": {("hip_r", "X"): (-0.4, 0.3, 1.3, 0.9), ("knee_r", "X"): (-0.2, -0.6, -1.4, -0.5)},
    "kick": {("hip_l", "X"): (-0.4, 0.2, 1.1, 0.2), ("knee_l", "X"): (-1.1, -1.2, -0.1, -0.3)},
    "bow": {("thorax", "X"): (0.3, -0.1, -1.2, -0.7), ("neck", "X"): (0.2, 0.0, -0.4, -0.2)},
    "push": {**_both("shoulder", "X", 0.3, 0.7, 1.4, 0.9), **_both("elbow", "X", 2.3, 1.8, 0.1, 1.2)},
    "throw": {
        ("shoulder_r", "Y"): (-1.3, -1.5, -1.4, -0.8),
        ("shoulder_r", "Z"): (-0.9, -0.2, 0.8, 1.2),
        ("elbow_r", "X"): (1.2, 0.7, 0.1, 0.4),
    },
    "fold the arms": {
        **_both("shoulder", "X", -0.3, 0.4, 0.8, 0.8),
        **_both("shoulder", "Z", 0.0, -0.3, -0.7, -0.5),
        **_both("elbow", "X", 0.3, 1.2, 1.7, 1.9),
    },
}
"""Angles (radians) at the start, after a third and two thirds of the time, and at the end, of coordinates that move."""


def swung(motion: str, body: Any, times: Floats, rng: np.random.Generator) -> Floats:
    """States (T, d) of a motion: angles of its own from run to run, and a body that is turned a little."""
    states = np.tile(np.asarray(body.rest, float), (len(times), 1))
    share = 3 * np.asarray(times) / max(float(times[-1]), 1e-9)
    step = np.clip(np.floor(share), 0, 2).astype(int)
    part = share - step
    part = part * part * (3 - 2 * part)
    for coordinate, keys in MOTIONS[motion].items():
        angles = np.array(keys) * rng.uniform(0.9, 1.05) + 0.05 * rng.normal(size=4)
        states[:, body.tree.coordinates.index(coordinate)] = angles[step] + part * (angles[step + 1] - angles[step])
    states[:, body.tree.coordinates.index(("pelvis", "Z"))] += rng.uniform(-0.2, 0.2)
    low, high = body.limits.T
    within: Floats = np.clip(states, low + 0.02, high - 0.02)
    return within


Program = Callable[[Any, Floats, np.random.Generator], Floats]
PROGRAMS: Mapping[str, Program] = {
    "arm": arm,
    "pivot": pivot,
    "turns": turns,
    **{name: partial(swung, name) for name in MOTIONS},
}


@lru_cache(maxsize=64)
def moving(scene: str, kind: str, recording: Recording, rate: float, seconds: float, seed: int, begin: float = BEGIN) -> Moving:
    """Make a motion.

    Args:
        scene: A name of PROGRAMS, or "recorded".
        kind: The body, "arm", "stiff_shoulders" or "full".
        recording: Whose motion it is where it is "recorded".
        rate: Frames a second.
        seconds: How long it is.
        seed: Seed of a program; recordings do not depend on it.
        begin: Second of the recording at which its motion begins.
    """
    build = load_builder(_BODY)
    if scene == "recorded":
        return _recorded(build, kind, recording, rate, seconds, begin)
    body: Any = build(kind)
    times = np.arange(round(seconds * rate)) / rate
    states = PROGRAMS[scene](body, times, np.random.default_rng([seed, len(scene)]))
    return Moving(body, states, _markers(body, states))


def _recorded(build: Any, kind: str, recording: Recording, rate: float, seconds: float, begin: float) -> Moving:
    """The frames of a recording that are nearest to the rate."""
    assert recording.path is not None
    own = read_motion(recording.path, recording.skeleton).rate
    step = max(1, round(own / rate))
    first = round(begin * own)
    subject = recorded_subject(
        recording.path,
        recording.skeleton,
        model=f"poseppl_models.sminchisescu_triggs.programs:{'full_body' if kind == 'full' else kind}",
        frames=f"{first}:{first + step * round(seconds * own / step)}:{step}",
    )
    return Moving(build(kind, dict(subject.body.lengths)), subject.states, subject.complete_markers())


def _swung(
    body: Any,
    times: Floats,
    rng: np.random.Generator,
    swings: Mapping[tuple[str, str], tuple[float, float]],
    hertz: tuple[float, float],
) -> Floats:
    """A body at rest some of whose joints swing: middle and amplitude (radians) by coordinate, frequencies drawn."""
    states = np.tile(np.asarray(body.rest, float), (len(times), 1))
    for row, coordinate in enumerate(body.tree.coordinates):
        if coordinate in swings:
            middle, amplitude = swings[coordinate]
            phase, frequency = rng.uniform(0, 2 * np.pi), rng.uniform(*hertz)
            states[:, row] = middle + amplitude * np.sin(2 * np.pi * frequency * times + phase)
    low, high = body.limits.T
    within: Floats = np.clip(states, low + 0.02, high - 0.02)
    return within


def _add(body: Any, states: Floats, angles: Mapping[tuple[str, str], Floats]) -> None:
    for coordinate, angle in angles.items():
        states[:, body.tree.coordinates.index(coordinate)] += angle


def _smooth_step(x: Floats) -> Floats:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)


def _markers(body: Any, states: Floats) -> Floats:
    return np.asarray(jax.vmap(lambda state: marker_positions(body.tree, state))(jnp.asarray(states, float)), np.float64)


def axis_of_motion(names: Sequence[str], markers: Floats) -> Floats:
    """Horizontal unit vector (2,) in which hands and feet move most, of markers (T, K, 3), relative to the first one."""
    ends = [list(names).index(name) for name in _ENDS]
    places = markers[:, ends, :2] - markers[:, :1, :2]
    moved = (places - places.mean(0)).reshape(-1, 2)
    axis: Floats = np.linalg.eigh(moved.T @ moved)[1][:, -1]
    return axis * (1.0 if axis[1] >= 0 else -1.0)
