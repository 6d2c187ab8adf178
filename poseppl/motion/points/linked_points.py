"""Points that a skeleton links: those that hang together are smoothed together, at distances near lengths with a posterior.

Params are those that were found for each point by itself. A length without a prior in the skeleton is about what the points by
themselves have it, with a standard deviation of half of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from poseppl_models.bodies.named_points import points_in_cameras

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.motion.bodies.body import PointInputs, compile_once
from poseppl.motion.io.skeleton_files import Link, Skeleton
from poseppl.motion.points.fit import NEAR_STEPS, OF_A_POINT, PointParams, under_draws
from poseppl.motion.points.named_points import PointProblem, places_of
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.curvature import draws_about, find_mode

UNKNOWN = 0.5
"""Standard deviation of a length of which the skeleton says nothing, in units of what is measured."""
_STEPS = 10


class LinkedDraws(NamedTuple):
    """Draws of points that hang together, in local coordinates.

    Attributes:
        members: Their k indices.
        links: Indices of the skeleton's links between them.
        mode: (T, k, 3).
        places: (S, T, k, 3).
        lengths: (S, L) of the links.
    """

    members: tuple[int, ...]
    links: tuple[int, ...]
    mode: Floats
    places: Floats
    lengths: Floats


def linked_draws(
    problem: PointProblem, found: PointParams, mode: Array, skeleton: Skeleton, num_draws: int, seed: int
) -> list[LinkedDraws]:
    """Smooth what hangs together; to be called in double precision.

    Args:
        problem: The problem of the points by themselves.
        found: Their params, the likeliest and D draws.
        mode: Their states (K, T, d) under the likeliest.
        skeleton: The links.
        num_draws: S; draw s belongs to the draw of the params that :func:`~poseppl.motion.points.fit.under_draws` returns.
        seed: Seed of the draws.
    """
    groups = []
    for number, members in enumerate(components(len(skeleton.points), skeleton.links)):
        chosen = [index for index, link in enumerate(skeleton.links) if link.ends[0] in members]
        links = [skeleton.links[index] for index in chosen]
        ends = tuple((members.index(link.ends[0]), members.index(link.ends[1])) for link in links)
        inputs, data, states = _together(problem, mode, members, links, ends)
        num_cameras = inputs.magnification.shape[1]
        model = compile_once(points_in_cameras(len(members), num_cameras, ends), jax.tree.map(lambda leaf: leaf[0], inputs))
        likeliest, spread = ({name: _own(name, value, members) for name, value in each.items()} for each in found)
        key = jax.random.fold_in(jax.random.key(seed), number)
        states = _mode(model, likeliest, jax.vmap(model.to_flat)(states), data, inputs, _STEPS)
        middle, drawn = np.asarray(places_of(model, states)), []
        for rows in under_draws(spread, num_draws):
            own = {name: value[rows[0]] for name, value in spread.items()}
            there = _mode(model, own, states, data, inputs, NEAR_STEPS)
            drawn.append(_draws(model, len(rows), jax.random.fold_in(key, rows[0]), own, there, data, inputs))
        places, lengths = (np.concatenate(each) for each in zip(*drawn, strict=True))
        groups.append(LinkedDraws(members, tuple(chosen), middle, places, lengths))
    return groups


def _own(name: str, value: Array, members: tuple[int, ...]) -> Array:
    """Params (..., K) of the members alone, where each point has its own."""
    return value[..., np.asarray(members)] if name in OF_A_POINT else value


def components(num_points: int, links: Sequence[Link]) -> list[tuple[int, ...]]:
    """The points that hang together by links, each group in order; points without a link are in none."""
    group = list(range(num_points))
    for link in links:
        first, second = (group[end] for end in link.ends)
        group = [min(first, second) if own in (first, second) else own for own in group]
    groups = [tuple(k for k in range(num_points) if group[k] == own) for own in sorted(set(group))]
    return [members for members in groups if len(members) > 1]


def _together(
    problem: PointProblem, mode: Array, members: tuple[int, ...], links: Sequence[Link], ends: Sequence[tuple[int, int]]
) -> tuple[PointInputs, Observation, dict[str, Array]]:
    """Inputs, data and states of points, side by side; all with a leading T."""
    index, own, unit = np.asarray(members), problem.inputs, problem.frame.unit
    single = jax.vmap(jax.vmap(problem.model.to_sites))(mode[index])
    motion = jnp.moveaxis(single["motion"][:, :, 0], 0, 1)
    position = motion[..., 0]
    errors = {name: jnp.moveaxis(single[name][:, :, :, 0], 0, 2) for name in ("error", "bias")}
    num_frames = len(position)
    measured = [float(jnp.median(jnp.linalg.norm(position[:, i] - position[:, j], axis=-1))) for i, j in ends]
    length = np.array([own if link.length is None else link.length * unit for link, own in zip(links, measured, strict=True)])
    spread = [UNKNOWN * own if link.spread is None else link.spread * unit for link, own in zip(links, length, strict=True)]
    rows = [
        np.broadcast_to(values, (num_frames, len(links))) for values in (length, spread, [link.give for link in links] * length)
    ]
    inputs = own._replace(
        logit=jnp.moveaxis(own.logit[index, :, :, 0], 0, 2),
        start=jnp.moveaxis(own.start[index, :, 0], 0, 1),
        **{name: jnp.asarray(row, float) for name, row in zip(("length", "length_scale", "tolerance"), rows, strict=True)},
    )
    values, mask = (
        {"points": jnp.moveaxis(site["points"][index, :, :, 0], 0, 2), "links": fill((num_frames, len(links)), kind)}
        for site, fill, kind in ((problem.observations.values, jnp.zeros, float), (problem.observations.mask, jnp.ones, bool))
    )
    states = {"motion": motion, **errors, "length": jnp.asarray(rows[0], float)}
    return inputs, Observation(values, mask), states


@partial(jit, static_argnums=(0, 5))
def _mode(
    model: CompiledModel, params: dict[str, Array], start: Array, data: Observation, inputs: PointInputs, num_steps: int
) -> Array:
    return find_mode(model.with_params(params), start, data, inputs, num_steps, majorised=True)


@partial(jit, static_argnums=(0, 1))
def _draws(
    model: CompiledModel,
    num_draws: int,
    rng_key: Array,
    params: dict[str, Array],
    mode: Array,
    observations: Observation,
    inputs: PointInputs,
) -> tuple[Array, Array]:
    """Draws (S, T, k, 3) of positions, and (S, L) of lengths, around a mode (T, d)."""

    def summary_of(drawn: Array) -> tuple[Array, Array]:
        return places_of(model, drawn), jnp.mean(jax.vmap(model.to_sites)(drawn)["length"], 0)

    places, lengths = draws_about(model.with_params(params), num_draws, rng_key, mode, observations, inputs, summary_of)
    return places, lengths
