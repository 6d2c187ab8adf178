"""Named points smoothed: draws of all trajectories given all frames, and what a camera would see of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

from poseppl.arrays import Floats, Integers
from poseppl.compilation import double_precision, jit
from poseppl.motion.bodies.body import PointInputs
from poseppl.motion.io.skeleton_files import Skeleton
from poseppl.motion.points.fit import NEAR_STEPS, fit_points, params_by_point, points_mode, under_draws
from poseppl.motion.points.linked_points import linked_draws
from poseppl.motion.points.named_points import (
    BY_POINT,
    LocalFrame,
    PointProblem,
    PointRecording,
    make_point_problem,
    places_of,
)
from poseppl.motion.points.swaps import Pair, SeenPoints, exchanged, swap_probabilities
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.curvature import draws_about

MAX_FITTED, RUNS_FITTED = 150, 5
"""Frames that params are sought in, and how many runs of frames in a row, spread over the recording, they are."""


class PointTracks(NamedTuple):
    """Smoothed points.

    Attributes:
        places: (S, T, K, 3) draws of whole trajectories, mm.
        mode: (T, K, 3), mm.
        params: The likeliest params; those of points are (K,).
        drawn_params: Params (S, ...) that each draw of the places is under.
        frame: Coordinates that lengths of the params are in.
        clutter: (T, C, K) probability that what was found is clutter; NaN where nothing was.
        lengths: (S, L) draws of the skeleton's links' lengths, mm.
        swaps: (T, C, P) probability that the limbs of each of the skeleton's pairs are exchanged in a camera.
    """

    places: Floats
    mode: Floats
    params: Mapping[str, Floats]
    drawn_params: Mapping[str, Floats]
    frame: LocalFrame
    clutter: Floats
    lengths: Floats
    swaps: Floats


def smooth_points(
    recording: PointRecording,
    *,
    skeleton: Skeleton | None = None,
    known: Mapping[str, float] | None = None,
    num_draws: int = 200,
    seed: int = 0,
) -> PointTracks:
    """Smooth points, each by itself where no skeleton links them.

    Args:
        recording: The detections.
        skeleton: Links between its points, which are in the same order.
        known: Params of the detector that are not sought in the recording.
        num_draws: S.
        seed: Seed of the draws.

    Raises:
        InputError: No point is seen by two cameras at a time.
    """
    with double_precision():
        problem = make_point_problem(recording)
        part = best_seen(recording.points, MAX_FITTED, RUNS_FITTED)
        fitted = problem if part is None else make_point_problem(recording.of_frames(part))
        params, spread = found = fit_points(fitted, known, seed=seed)
        mode = points_mode(problem, params)
        pairs = () if skeleton is None else skeleton.pairs
        swaps = _swaps(problem, params, mode, recording, pairs)
        if np.any(swaps > 0.5):
            points, confidence = (exchanged(values, swaps, pairs) for values in (recording.points, recording.confidence))
            problem = make_point_problem(recording._replace(points=points, confidence=confidence))
            mode = points_mode(problem, params)
            swaps = _swaps(problem, params, mode, recording, pairs)
        drawn, rows = _all_draws(problem, spread, mode, num_draws, seed)
        linked = [] if skeleton is None else linked_draws(problem, found, mode, skeleton, num_draws, seed)
        places, middle = (
            np.moveaxis(np.asarray(drawn), 0, 2).copy(),
            np.moveaxis(np.asarray(places_of(problem.model, mode))[:, :, 0], 0, 1).copy(),
        )
        lengths = np.zeros((num_draws, 0 if skeleton is None else len(skeleton.links)))
        for group in linked:
            places[:, :, group.members], middle[:, group.members] = group.places, group.mode
            lengths[:, group.links] = group.lengths / problem.frame.unit
        return PointTracks(
            problem.frame.to_world(places),
            problem.frame.to_world(middle),
            {name: np.asarray(value) for name, value in params.items()},
            {name: np.asarray(value)[rows] for name, value in spread.items()},
            problem.frame,
            seen_points(problem, params, mode).clutter_probability(recording.points),
            lengths,
            swaps,
        )


def seen_points(problem: PointProblem, params: Mapping[str, Array], mode: Array) -> SeenPoints:
    """Predict the image points of states (K, T, d), with the detector's errors there."""
    predicted = _predicted(problem.model, dict(params), mode, problem.inputs)
    seen, scale, odds = (np.moveaxis(np.asarray(predicted[name])[:, :, :, 0], 0, 2) for name in ("seen", "scale", "log_odds"))
    return SeenPoints(seen, scale, odds, np.asarray(problem.inputs.window[0]))


def _swaps(
    problem: PointProblem, params: Mapping[str, Array], mode: Array, recording: PointRecording, pairs: Sequence[Pair]
) -> Floats:
    if not pairs:
        return np.zeros((*recording.points.shape[:2], 0))
    elapsed = np.asarray(problem.inputs.elapsed)
    return swap_probabilities(recording.points, seen_points(problem, params, mode), pairs, elapsed)


def best_seen(points: Floats, most: int, num_runs: int) -> Integers | None:
    """Frames (most,) with the most points (T, C, K, 2), a run of them in each of equal parts; None if all are no more."""
    if len(points) <= most:
        return None
    seen = np.isfinite(points).all(-1).sum((1, 2))
    return np.concatenate(
        [part[_best_run(seen[part], most // num_runs)] for part in np.array_split(np.arange(len(points)), num_runs)]
    )


def _best_run(seen: Integers, length: int) -> slice:
    """The run of so many frames with the largest sum."""
    sums = np.cumsum(np.r_[0, seen])
    first = int(np.argmax(sums[length:] - sums[:-length]))
    return slice(first, first + length)


def _all_draws(
    problem: PointProblem, spread: Mapping[str, Array], mode: Array, num_draws: int, seed: int
) -> tuple[Floats, Integers]:
    """Draws (K, S, T, 3) of places, and which of the draws of params (S,) each of them is under."""
    drawn = []
    for rows in (groups := under_draws(spread, num_draws)):
        params = {name: value[rows[0]] for name, value in spread.items()}
        there = points_mode(problem, params, mode, NEAR_STEPS)
        key = jax.random.fold_in(jax.random.key(seed), rows[0])
        drawn.append(np.asarray(_draws(problem.model, len(rows), key, params, there, problem.observations, problem.inputs)))
    return np.concatenate(drawn, 1), np.concatenate(groups)


@partial(jit, static_argnums=(0, 1))
def _draws(
    model: CompiledModel,
    num_draws: int,
    rng_key: Array,
    params: dict[str, Array],
    mode: Array,
    observations: Observation,
    inputs: PointInputs,
) -> Array:
    """Draws (K, S, T, 3) of places around modes (K, T, d)."""
    split, axes = params_by_point(params)

    def one(key: Array, params: Any, xs: Array, observations: Observation, inputs: PointInputs) -> Array:
        own = model.with_params(params)
        trajectories: Array = draws_about(
            own, num_draws, key, xs, observations, inputs, lambda drawn: places_of(model, drawn)[:, 0]
        )
        return trajectories

    keys = jax.random.split(rng_key, len(mode))
    drawn: Array = jax.vmap(one, in_axes=(0, axes, 0, 0, BY_POINT))(keys, split, mode, observations, inputs)
    return drawn


@partial(jit, static_argnums=0)
def _predicted(model: CompiledModel, params: dict[str, Array], mode: Array, inputs: PointInputs) -> dict[str, Array]:
    """The programs' deterministic sites at states (K, T, d), each (K, T, C, 1, ...)."""
    split, axes = params_by_point(params)

    def one(params: Any, xs: Array, inputs: PointInputs) -> dict[str, Array]:
        return jax.vmap(model.with_params(params).extras)(xs, inputs)

    sites: dict[str, Array] = jax.vmap(one, in_axes=(axes, 0, BY_POINT))(split, mode, inputs)
    return sites
