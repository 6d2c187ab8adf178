"""One run of a filter on the frames of a problem: errors, seconds, and the particles' mean likelihood."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from image_systems import Problem

from poseppl.diagnostics import marker_errors, virtual_markers
from poseppl.filters import Filter
from poseppl.motion.geometry import marker_positions

FIGURES = ("absolute", "relative", "weighted_relative", "optimistic")
_BLOCK = 250


def first_state(problem: Problem, filter: Filter, seed: int) -> Any:
    """The state before frame 0, which is a step like any other, so that one program is compiled: the start's mean.

    A step of the walk makes it the Gaussian start. DE-MC's population, which may not walk, is spread already.
    """
    inputs = problem.frames[0]
    like = jax.eval_shape(filter.init, jax.random.key(0), problem.model.observe({}), inputs)[0]
    noise = jax.random.normal(jax.random.key(seed), like.particles.shape) if "velocity" in like._fields else 0.0
    known = {
        "particles": jnp.broadcast_to(inputs.start, like.particles.shape) + noise * inputs.start_scale,
        "log_weights": jnp.full(like.log_weights.shape, -np.log(len(like.particles))),
        "best": inputs.start,
        "velocity": jnp.zeros_like(inputs.start),
    }
    return like._replace(**{name: known[name].astype(getattr(like, name).dtype) for name in like._fields})


def track(problem: Problem, step: Callable[..., Any], state: Any, seed: int) -> dict[str, Any]:
    """One run: errors, seconds and ESS / N of each frame, and the mean likelihood of the particles."""
    model, key = problem.model, jax.random.key(seed + 1)
    data = model.observe({})
    errors, seconds, weights, shares, failed = [], [], [], [], 0
    for number, inputs in enumerate(problem.frames):
        started = time.perf_counter()
        state, info = jax.block_until_ready(step(jax.random.fold_in(key, number), state, data, inputs))
        seconds.append(time.perf_counter() - started)
        errors.append(score(problem, state.particles, np.exp(np.asarray(state.log_weights, np.float64)), number))
        shares.append(float(info.ess) / len(state.particles))
        failed += int(info.failed)
        if problem.system == "du-guan":
            weights.append(average_weight(model, state.particles, inputs))
    return {
        "errors": errors,
        "seconds": seconds,
        "weight": weights or [np.nan],
        "ess_share": shares,
        "failed": failed,
        "evaluations": int(info.num_likelihood),
    }


def score(problem: Problem, particles: Any, weights: np.ndarray, frame: int) -> list[float]:
    """The figures of one frame."""
    tree = problem.body.tree
    places = virtual_markers(tree.marker_names, _places(tree, jnp.asarray(particles, float)))
    found = marker_errors(places[None], weights[None], problem.seen.truth[None, frame])
    return [float(np.mean(getattr(found, name))) for name in FIGURES]


@jax.jit
def _places(tree: Any, states: jax.Array) -> jax.Array:
    return jax.vmap(partial(marker_positions, tree))(states)


def average_weight(model: Any, particles: jax.Array, inputs: Any) -> float:
    """Mean likelihood of particles (N, d), taken in blocks of one size, so that every filter's are compiled together."""
    blocks = np.array_split(np.arange(len(particles)), -(-len(particles) // _BLOCK))
    padded = [np.resize(block, _BLOCK) for block in blocks]
    values = [
        np.asarray(_likelihoods(model, particles[rows], inputs))[: len(block)]
        for rows, block in zip(padded, blocks, strict=True)
    ]
    return float(np.mean(np.exp(np.concatenate(values).astype(np.float64))))


@partial(jax.jit, static_argnums=0)
def _likelihoods(model: Any, states: jax.Array, inputs: Any) -> jax.Array:
    return jax.vmap(lambda x: model.log_observation(x, model.observe({}), inputs))(states)
