"""The built-in walk: one subject's gait in closed form, on the body of Choo and Fleet 2001.

``walk.json`` contains the coefficients of :mod:`poseppl.motion.bodies.gait_fit` for every coordinate of the body and the
subject's segment lengths; :func:`gait_table` made it from walk 02_01 of the CMU motion capture database (mocap.cs.cmu.edu),
with four harmonics. Its markers follow the recorded ones to 25 mm on average, 10 mm relative to the pelvis, over two and a half
cycles.

>>> states, lengths = walk(rate=60.0, num_frames=120)
>>> states.shape
(120, 28)
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.bodies.gait_fit import Gait, fit_gait, from_table, to_table
from poseppl.motion.bodies.subject import fit_subject
from poseppl.motion.io.motion import Motion
from poseppl_models.bodies.choo_fleet import choo_fleet_tree, full_body

NUM_HARMONICS = 4


class Walk(NamedTuple):
    """States (T, 28) of a walk, and the walker's segment lengths in mm."""

    states: Floats
    lengths: dict[str, float]


def walk(rate: float = 60.0, num_frames: int = 120) -> Walk:
    """Walk along +X from above the origin.

    Args:
        rate: Frames a second.
        num_frames: T, as many as wanted: the walk goes on for ever.

    Returns:
        The states (T, 28) of the body and the subject's segment lengths in mm.

    Raises:
        ValueError: ``rate`` or ``num_frames`` is not positive.
    """
    if not rate > 0 or num_frames < 1:
        raise ValueError(f"{num_frames} frames at {rate:g} a second, expected positive numbers")
    gait, lengths = _built_in()
    return Walk(gait.at(np.arange(num_frames) / rate), dict(lengths))


def gait_table(motion: Motion, num_harmonics: int = NUM_HARMONICS) -> dict[str, Any]:
    """Fit body and gait to a recorded walk; the content of ``walk.json``.

    Args:
        motion: A walk along a straight line, at least 1.1 cycles.
        num_harmonics: Harmonics of the cycle.

    Returns:
        The gait's table (:func:`poseppl.motion.bodies.gait_fit.to_table`) and ``lengths`` in mm.

    Raises:
        InputError: The recording lacks joints of the body.
        ValueError: It is too short or does not move.
    """
    subject = fit_subject(motion, full_body)
    gait = fit_gait(subject.states, motion.rate, num_harmonics)
    lengths = {name: round(length, 1) for name, length in subject.body.lengths.items()}
    return {"lengths": lengths, **to_table(gait, subject.body.tree.coordinate_names)}


@cache
def _built_in() -> tuple[Gait, dict[str, float]]:
    table = json.loads(files("poseppl_models.bodies").joinpath("walk.json").read_text(encoding="utf-8"))
    lengths: dict[str, float] = table["lengths"]
    return from_table(table, choo_fleet_tree(lengths).coordinate_names), lengths
