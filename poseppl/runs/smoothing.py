"""The driver of smoothers: from a filter's history to what is kept of the smoothed frames.

    history = run_filter(filter, rng_key, observations, inputs, collect=collect_history).outputs
    run = run_smoother(smoother, rng_key, history, observations, inputs, collect=collect_draws(model))

The data of frames that the filter reported as failed are masked, so that a smoother passes over them as over frames without
data. The collectors are those of :func:`poseppl.runs.run.run_filter`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

from poseppl.arrays import Booleans
from poseppl.checks import check_key
from poseppl.compilation import compile_smoother, jit
from poseppl.errors import PosepplError
from poseppl.gaussians.marginals import Marginals
from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import tree_index
from poseppl.program import Observation
from poseppl.program.earlier_inputs import with_earlier_data
from poseppl.program.large_integers import overflow_message, overflown
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.compiled_scan import abstract_signature
from poseppl.runs.frame_sequence import device_array, frame_sequence
from poseppl.runs.gaussian_draws import GaussianCollector
from poseppl.runs.recompilation import warn_recompilation
from poseppl.runs.run import Collect
from poseppl.runs.step_output import is_finite
from poseppl.smoothers.base import Approximation, History, Smoothed, Smoother, SmoothingInfo
from poseppl.stored_programs import key_of, recalled

_MAX_UNREACHABLE = 0.05
"""Share of a frame's smoothed states above which a smoothing that cannot reach them is refused."""


class SmoothingError(PosepplError):
    """A smoothing whose result is not finite, or that could not go back from frame to frame."""


class SmoothingRun(NamedTuple):
    """Result of a smoothing, as NumPy arrays.

    Attributes:
        outputs: Output of `collect` for each frame, with a leading T.
        info: Diagnosis.
        num_particles: N, where a frame is weighted particles or single trajectories; None where it is M chains.
        compile_seconds: Time to trace and compile.
        wall_seconds: Time of the smoothing itself.
        method: Properties that the smoother declares, by name, for the result.
        cpu_seconds: Processor time of the smoothing itself, of all threads of the process.
        approximation: The fit of a smoother that fits a distribution to the posterior.
    """

    outputs: Any
    info: SmoothingInfo
    num_particles: int | None
    compile_seconds: float
    wall_seconds: float
    method: Mapping[str, Any]
    cpu_seconds: float = float("nan")
    approximation: Approximation | None = None


class _Frame(NamedTuple):
    """A smoothed frame in the form that collectors read."""

    particles: Array
    log_weights: Array
    marginals: Marginals | None


def run_smoother(
    smoother: Smoother,
    rng_key: Array,
    history: History,
    observations: Observation,
    inputs: Any = None,
    *,
    collect: Collect,
) -> SmoothingRun:
    """Smooth a sequence.

    Args:
        smoother: The smoother.
        rng_key: PRNG key; the same key gives the same result.
        history: Record of the filter.
        observations: The data that the filter saw, with a leading T.
        inputs: Its inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`.
        collect: Collector of each frame; see :mod:`poseppl.runs.collectors`.

    Raises:
        ValueError: The history is no History, the data are no Observation, or an array does not have T rows.
        SmoothingError: The result is not finite, or no state that the filter left leads to those of the next frame.
    """
    if not isinstance(history, History):
        raise ValueError(
            f"The history is a {type(history).__name__}. Expected what the filter left: the outputs of run_filter(..., "
            "collect=collect_history), with all particles, weights and ancestors."
        )
    check_key(rng_key)
    history = jax.tree.map(lambda leaf: leaf if isinstance(leaf, np.ndarray) else device_array(leaf), history)
    num_frames = history.particles.shape[0]
    sequence = frame_sequence(observations, with_earlier_data(smoother.model, observations, inputs), num_frames)
    whole = sequence.stacked_inputs()
    data = mask_failed(sequence.observations, np.asarray(history.failed))
    started = time.perf_counter()
    gaussian = _gaussian(smoother, collect, whole)
    compiled = _compiled(smoother, gaussian is not None, rng_key, history, data, whole)
    ready, processor = time.perf_counter(), time.process_time()
    smoothed = compiled(rng_key, history, data, whole)
    jax.tree.leaves(smoothed)[0].block_until_ready()
    seconds, spent = (ready - started, time.perf_counter() - ready), time.process_time() - processor
    if gaussian is None:
        count = smoothed.particles.shape[1] if smoothed.particles.ndim == 3 else None
        finite, outputs = jax.tree.map(np.asarray, _collected(smoother, collect, rng_key, smoothed, whole))
    else:
        count = smoother.num_draws
        outputs = gaussian.draw_backwards(rng_key, smoothed, count)
        finite = np.isfinite(outputs.state).all() and np.isfinite(outputs.summary["state_sd"]).all()
    if not finite:
        raise SmoothingError(_breakdown(smoother, smoothed))
    info = jax.tree.map(np.asarray, smoothed.info)
    _check_reachable(info.unreachable)
    fitted = jax.tree.map(np.asarray, getattr(smoothed, "approximation", None))
    return SmoothingRun(outputs, info, count, *seconds, smoother.provenance, spent, fitted)


def _check_reachable(unreachable: np.ndarray[Any, Any]) -> None:
    """Refuse a smoothing of which too much is the filter's."""
    frame = int(np.argmax(unreachable))
    if unreachable[frame] > _MAX_UNREACHABLE:
        raise SmoothingError(
            f"frame {frame} (counted from 0): {unreachable[frame]:.0%} of the smoothed states cannot come from any state that "
            "the filter left there, so nothing can be said of earlier frames. A state with parts that have no noise needs all "
            "of a particle filter's particles (keep its history, and take more), rauch_tung_striebel_smoother, or "
            "particle_gibbs_smoother"
        )


def _breakdown(smoother: Smoother, smoothed: Any) -> str:
    """Why smoothed states cannot be used."""
    model = smoother.model if isinstance(smoothed, Smoothed) else None  # Gaussians are of no integers
    names = [] if model is None else overflown(model.sites, smoothed.particles)
    if names:
        return overflow_message(names)
    return "the smoothed states are not finite: the model or the settings of the smoother break down"


def mask_failed(observations: Observation, failed: Array | Booleans) -> Observation:
    """Hide the data of failed frames; `failed` is (T,)."""

    def hide(mask: Array) -> Array:
        return mask & ~failed.reshape(-1, *(1,) * (mask.ndim - 1))

    return observations._replace(mask=jax.tree.map(hide, observations.mask))


def _gaussian(smoother: Smoother, collect: Collect, inputs: Any) -> GaussianCollector | None:
    """The collector of draws of the smoother's Gaussians; None where it has none, or the result has more than draws."""
    gaussian: GaussianCollector | None = getattr(collect, "gaussian", None)
    if smoother.passes is None or gaussian is None:
        return None
    serves, kind = _serving(smoother, collect), abstract_signature(inputs)
    if kind not in serves:
        serves[kind] = gaussian.serves(tree_index(inputs, 0))
    return gaussian if serves[kind] else None


@memoized_builder
def _serving(smoother: Smoother, collect: Collect) -> dict[Any, bool]:
    """Whether the collector of Gaussians serves, by the kind of the inputs."""
    return {}


def _compiled(smoother: Smoother, passes: bool, *given: Any) -> Any:
    """The smoother's function of the key of the run, the history, data and inputs, compiled once for data of one kind.

    With `passes`, its passes in place of what it draws.
    """
    smooth, made = _smoothing(smoother, passes)
    kind = abstract_signature(given)
    if kind not in made:
        particles = given[1].particles[0]
        sizes = len(particles), particles.size, smoother.closed_form
        key = key_of(given, smoother, passes)
        made[kind] = recalled(key, "smoother", lambda: compile_smoother(smooth.lower(*given), *sizes))
    return made[kind]


@memoized_builder
def _smoothing(smoother: Smoother, passes: bool) -> tuple[Any, dict[Any, Any]]:
    """The smoother's function, jitted, from the key of the run; and, by the kind of its data, what was compiled of it."""

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any) -> Any:
        if passes and smoother.passes is not None:
            return smoother.passes(history, observations, inputs)
        return smoother.smooth(jax.random.split(rng_key)[0], history, observations, inputs)

    return jit(smooth), {}


def _collected(smoother: Smoother, collect: Collect, *given: Any) -> tuple[Array, Any]:
    """Whether all states are finite, and what is kept of the frames; compiled once for data of one kind."""
    collected, made = _collecting(smoother, collect)
    kind = abstract_signature(given)
    if kind not in made:
        size = given[1].log_weights[0].size
        key = key_of(given, smoother, collect)
        made[kind] = recalled(key, "collected", lambda: compile_smoother(collected.lower(*given), size, size, closed_form=True))
    result: tuple[Array, Any] = made[kind](*given)
    return result


@memoized_builder
def _collecting(smoother: Smoother, collect: Collect) -> tuple[Any, dict[Any, Any]]:
    """A jitted function that lets the collector see one frame after another, and what was compiled of it.

    It returns besides whether all states are finite.

    Trajectories count as one chain, and stay whole.
    Those of a chain count alike: trajectories are resampled by their weights, which changes nothing where these are equal.
    """
    warn_recompilation(smoother, "collector", collect)

    def collected(rng_key: Array, smoothed: Smoothed, inputs: Any) -> tuple[Array, Any]:
        frames = _Frame(smoothed.particles, smoothed.log_weights, smoothed.marginals)
        key_trajectories, key_frames = jax.random.split(jax.random.split(rng_key)[1])
        if smoother.joint and smoothed.particles.ndim == 3:
            chosen = systematic(key_trajectories, smoothed.log_weights[-1], smoothed.log_weights.shape[1])
            particles, log_weights = (leaf[:, None, chosen] for leaf in frames[:2])
            frames = _Frame(particles, log_weights, smoothed.marginals)
        keys = jax.random.split(key_frames, smoothed.particles.shape[0])
        outputs = jax.lax.map(lambda row: collect(row[0], row[1], None, row[2]), (keys, frames, inputs))
        return is_finite(smoothed, smoother.model), outputs

    return jit(collected), {}
