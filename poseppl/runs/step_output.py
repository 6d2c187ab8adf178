"""The output that a run keeps of each frame: the collector's, the filter's diagnosis, and the history for smoothers."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.filters.base import Filter, FilterInfo, FilterState
from poseppl.filters.scan import Collect, collect_info
from poseppl.gaussians.gaussian import Gaussian, RootGaussian
from poseppl.program import CompiledModel
from poseppl.program.large_integers import are_exact
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.filter_history import history_of_frame, with_genealogy_alone
from poseppl.runs.gaussian_draws import GaussianCollector, GaussianFrames
from poseppl.runs.predictive import Prediction


class StepOutput(NamedTuple):
    """Draws and diagnosis kept of a frame; of a sequence, with a leading T.

    Attributes:
        outputs: Output of `collect`.
        info: The filter's diagnosis; its ``ancestors`` are left out (shape (T, 0)), for they are as many as the particles.
        unique_ancestors: How many particles of the frame before have offspring.
        finite: Whether all particles of positive weight were finite, and their integers exact.
        prediction: The frame's data against their :class:`~poseppl.runs.predictive.Prediction`; None if that is not asked for.
        history: Record of it for smoothers, see :mod:`poseppl.runs.filter_history`; None if it is not kept.
    """

    outputs: Any
    info: FilterInfo
    unique_ancestors: Any
    finite: Any
    prediction: Prediction | None
    history: Any


@memoized_builder
def collect_kept(filter: Filter, collect: Collect, keep: bool, lean: bool = False) -> Collect:
    """Keep of a frame :class:`StepOutput`, with or without the filter's history.

    With `lean`, outputs may be the moments of a Gaussian, of which :class:`GaussianCollector` makes draws.
    """
    gaussian: GaussianCollector | None = getattr(collect, "gaussian", None) if lean else None

    def collect_all(rng_key: Array, state: Any, info: FilterInfo, inputs: Any) -> StepOutput:
        history = history_of_frame(filter, state, info) if keep else None
        moments = gaussian.keep(state, inputs) if gaussian else None
        outputs = moments or collect(rng_key, state, with_genealogy_alone(filter, info), inputs)
        collected = collect_info(rng_key, state, info, inputs)
        return StepOutput(outputs, collected, _num_unique(info.ancestors), is_finite(state, filter.model), None, history)

    return collect_all


def with_draws(collect: Collect, kept: StepOutput, key: NDArray[np.uint32], start: int = 0) -> StepOutput:
    """Outputs of frames from `start` on, with draws in place of Gaussians; the key's data are those of one run or of series."""
    gaussian: GaussianCollector | None = getattr(collect, "gaussian", None)
    if gaussian is None or not isinstance(kept.outputs, GaussianFrames):
        return kept
    return kept._replace(outputs=gaussian.draw(kept.outputs, key, start))


def _num_unique(ancestors: Any) -> Any:
    """How many particles have offspring; known when the program is traced where a filter names none."""
    if isinstance(ancestors, np.ndarray):
        return np.int32(len(np.unique(ancestors)))
    return jnp.sum(jnp.zeros(ancestors.shape, jnp.int32).at[ancestors].set(1, mode="drop"))


def is_finite(state: FilterState, model: CompiledModel | None = None) -> Array:
    """Whether all particles of positive weight, or the Gaussian, are finite; if the model is given, its integers are exact."""
    posterior = getattr(state, "posterior", None)
    if isinstance(posterior, Gaussian | RootGaussian):
        return jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in posterior]))
    alive = state.log_weights > -jnp.inf
    right = jnp.isfinite(state.particles).all(-1)
    if model is not None:
        right = right & are_exact(model.sites, state.particles)
    return jnp.all((right | ~alive) & ~jnp.isnan(state.log_weights))


def joined(parts: list[StepOutput]) -> StepOutput:
    """Join the outputs of consecutive frames."""
    whole: StepOutput = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
    return whole
