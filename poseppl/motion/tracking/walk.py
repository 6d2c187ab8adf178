"""The random walk of a body: its scales per square root of a second, and its steps between two frames.

A coordinate moves by N(0, sigma^2 dt) in dt seconds, so that a second's motion has the same variance at any rate. Choo and
Fleet's 15 mm and 0.15 radians a frame at 30 Hz are 82 mm and 0.82 radians per square root of a second.

>>> steps = time_steps(np.array([0, 1, 2, 5]), 30.0)
>>> (30 * steps).round(6).tolist()
[1.0, 1.0, 1.0, 3.0]
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, Phrase
from poseppl.motion.bodies.body import Body, Posture
from poseppl.motion.tracking.start import scales

ASSUMED_RATE = 30.0
"""Frames a second where nobody has said: the rate that the scales were published for."""
UNKNOWN_RATE = Phrase(f"the frame rate is unknown: {ASSUMED_RATE:g} frames a second are assumed (", Argument("rate"), ")")
SIGMA_POSITION = 15.0 * ASSUMED_RATE**0.5
"""Default of bodies: translations, mm per square root of a second."""
SIGMA_ANGLE = 0.15 * ASSUMED_RATE**0.5
"""Default of bodies: angles, radians per square root of a second."""
MEMORY, SPREAD = 0.3, 2**0.5
"""Seconds in which a mean-reverting walk comes back, by a factor of e, and its standard deviation in units of the recorded one:
who is tracked may do other things; ours."""
VELOCITY_LASTS, UNEVEN = 0.2, 0.02
"""Seconds in which a velocity falls off by a factor of e; the variance of ways along none, in units of the others'; ours."""


def time_steps(frames: ArrayLike, rate: float | None) -> Floats:
    """Seconds (T,) to each frame from the one before it; to the first frame, as to most.

    Args:
        frames: Frame numbers (T,), ascending.
        rate: Frames a second, of frames that are as far apart as most; 30 if None.
    """
    gaps = np.diff(np.asarray(frames, np.float64))
    usual = float(np.median(gaps)) if gaps.size else 1.0
    return np.concatenate([[usual], gaps]) / usual / (rate or ASSUMED_RATE)


def walk_scales(body: Body, params: Mapping[str, float]) -> Floats:
    """Standard deviations (d,) of the body's motion in a second, mm and radians."""
    return scales(body, params.get("sigma_position", SIGMA_POSITION), params.get("sigma_angle", SIGMA_ANGLE))


def step_scales(body: Body, params: Mapping[str, float], seconds: Any = 1 / ASSUMED_RATE) -> Floats:
    """Standard deviations (..., d) of the body's motion in some seconds (...), a thirtieth by default."""
    return np.sqrt(np.asarray(seconds, np.float64))[..., None] * walk_scales(body, params)


def mean_reverting_steps(body: Body, params: Mapping[str, float], seconds: Floats) -> tuple[Floats, Posture]:
    """Steps of an Ornstein-Uhlenbeck process: angles come back to how people hold themselves, within :data:`MEMORY`.

    An angle's standard deviation is :data:`SPREAD` times that of recordings for ever, at any frame rate; what has none walks.

    Args:
        body: The body.
        params: Params of its walk.
        seconds: To each frame from the one before (T,).

    Returns:
        Standard deviations of the steps (T, d), and the posture, whose ``kept`` is (T, d).

    Raises:
        InputError: The body has no postures.
    """
    known = [index for index, coordinate in enumerate(body.tree.coordinates) if coordinate in body.postures]
    if not known:
        expected = "a body with postures, such as poseppl_models.bodies.choo_fleet:full_body; or fixed, or learned"
        raise InputError("this body has no usual posture", field=Argument("walk"), expected=expected)
    steps, mean, kept = step_scales(body, params, seconds), np.zeros(body.tree.dimension), np.exp(-seconds / MEMORY)[:, None]
    mean[known], spread = np.transpose([body.postures[body.tree.coordinates[index]] for index in known])
    steps[:, known] = SPREAD * spread * np.sqrt(1 - kept**2)
    left = np.ones_like(steps)
    left[:, known] = kept
    return steps, Posture(mean, left)


def velocity_steps(seconds: Floats) -> tuple[Floats, Floats, Floats]:
    r"""An Ornstein-Uhlenbeck process of velocities, integrated: what a frame keeps of them, and how far it goes.

    With h = exp(-dt / s) of velocities that last for s, the way of dt seconds given those at both ends is
    N(c (v + v'), 2 s (dt - 2 c) sigma^2), c = s (1 - h) / (1 + h): the trapezium rule where dt is short. Ways along no velocity
    add :data:`UNEVEN` of 2 s dt sigma^2, the variance of long ways.

    Args:
        seconds: To each frame from the one before (T,).

    Returns:
        h and c, seconds, each (T,), and the standard deviation of the way (T,) in units of sigma, seconds.
    """
    kept = np.exp(-seconds / VELOCITY_LASTS)
    step = VELOCITY_LASTS * (1 - kept) / (1 + kept)
    return kept, step, np.sqrt(2 * VELOCITY_LASTS * ((1 + UNEVEN) * seconds - 2 * step))
