"""The first frame of the bodytrack benchmark as an experiment takes it: programs, their inputs, known poses, and a score."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from poseppl.arrays import Floats
from poseppl.errors import FilePath
from poseppl.program import StateSpaceModel
from poseppl_models.bodytrack.files import read_bodytrack
from poseppl_models.bodytrack.likelihood import benchmark_score, bodytrack, limb_groups


class BodytrackSystem(NamedTuple):
    """The first frame.

    Attributes:
        program: The programs.
        params: Their params.
        inputs: Their inputs.
        limbs: Coordinates of each limb, for crossover.
        poses: States (31,) by name: "initial", and "reference" where it is known.
        step_scale: Standard deviations of a frame's motion (31,).
        scores: Scores of states by the samples they are taken from, "every" or "few"; of one state (31,).
    """

    program: StateSpaceModel
    params: Mapping[str, float]
    inputs: Any
    limbs: Sequence[Sequence[int]]
    poses: Mapping[str, Floats]
    step_scale: Floats
    scores: Mapping[str, Callable[[Array], Array]]


def bodytrack_system(folder: FilePath) -> BodytrackSystem:
    """Read the benchmark's folder; the programs take every sample.

    Args:
        folder: Such as ``sequenceB_1``.

    Raises:
        InputError: As :func:`poseppl_models.bodytrack.files.read_bodytrack`.
    """
    data = read_bodytrack(folder)
    inputs, body = data.inputs(), data.body

    def score(every: bool) -> Callable[[Array], Array]:
        return lambda state: benchmark_score(body, jnp.asarray(state, float), inputs, every=every)

    poses = {"initial": data.start} | ({"reference": data.reference[0]} if len(data.reference) else {})
    program, scores = bodytrack(body, every=True), {"every": score(True), "few": score(False)}
    return BodytrackSystem(program, {"beta": 1.0}, inputs, limb_groups(body), poses, data.step_scale, scores)
