"""The interface of every filter: a pair of pure functions, and one shape of diagnosis.

    init(rng_key, observation, inputs) -> (state, info)             the first frame
    step(rng_key, state, observation, inputs) -> (state, info)      each later frame

A state is a NamedTuple that carries no key and has at least `particles` and `log_weights`: (N, d) and (N,) for particle
filters, (M, R, d) and zeros (M, R) for M chains of R draws. One that knows the moments of the flat state has them as
`marginals`; a result's means, standard deviations and quantiles are then of these, not of draws. Everything that changes
between frames is an argument, so one compilation of `step` serves a sequence of any length. `inputs` follows the time
convention of `poseppl.program`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, Protocol

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.compilation import with_full_precision
from poseppl.errors import UnsuitableModelError
from poseppl.program import CompiledModel


class FilterState(Protocol):
    """Particles and weights, which every filter's state has."""

    @property
    def particles(self) -> Array:
        """Flat states (..., d)."""

    @property
    def log_weights(self) -> Array:
        """Log-weights (...), one for each particle."""


class FilterInfo(NamedTuple):
    """Diagnosis of one frame; every filter fills every field, by :func:`filter_info`.

    Attributes:
        log_evidence: log p(z_t | z_(<t)) as the filter estimates it, a scalar; -inf when the frame failed.
        ess: Effective number of particles or draws, a scalar.
        ancestors: For each particle its ancestor in the frame before (N,), int32.
        acceptance: Mean acceptance rate of the frame's moves, in [0, 1]; 1 when there are none.
        divergences: Number of divergent trajectories, int32.
        num_likelihood: Evaluations of the likelihood, int32.
        num_gradient: Evaluations of its gradient, int32.
        failed: Whether the data were impossible (every weight zero or NaN): the frame is then only predicted.
        step_size: Step size of the frame's moves; NaN when there are none.
    """

    log_evidence: Array
    ess: Array
    ancestors: Array
    acceptance: Array
    divergences: Array
    num_likelihood: Array
    num_gradient: Array
    failed: Array
    step_size: Array


def filter_info(
    log_evidence: Array,
    ess: Any,
    ancestors: Any,
    failed: Array,
    *,
    num_likelihood: Any,
    num_gradient: Any = 0,
    acceptance: Any = 1.0,
    divergences: Any = 0,
    step_size: Any = math.nan,
) -> FilterInfo:
    """Fill in a diagnosis, in the dtype of `log_evidence`; N for `ancestors` stands for particles of which each is its own."""
    dtype, own = log_evidence.dtype, ancestors
    if isinstance(ancestors, int):
        own = np.arange(ancestors, dtype=np.int32)  # of NumPy: known when a program is traced
    return FilterInfo(
        log_evidence=log_evidence,
        ess=jnp.asarray(ess, dtype),
        ancestors=own,
        acceptance=jnp.asarray(acceptance, dtype),
        divergences=jnp.asarray(divergences, jnp.int32),
        num_likelihood=jnp.asarray(num_likelihood, jnp.int32),
        num_gradient=jnp.asarray(num_gradient, jnp.int32),
        failed=failed,
        step_size=jnp.asarray(step_size, dtype),
    )


def identity(state: Any) -> Any:
    """The state itself."""
    return state


def check_noise(model: CompiledModel, others: str = "particle_filter, or for linear models kalman_filter") -> None:
    """Refuse models whose transition has no density over all coordinates, and name algorithms that take them.

    Raises:
        UnsuitableModelError: A site has no noise.
    """
    if model.noiseless:
        raise UnsuitableModelError(
            f"Site {model.noiseless[0]!r} has no noise (Delta), so that states have no density, which this algorithm needs. "
            f"Use {others}."
        )


EvidenceError = Literal["weights", "runs", "none"]


@dataclasses.dataclass(frozen=True, eq=False)
class Filter:
    """A filtering algorithm for one model; what was compiled for it is kept with it.

    Attributes:
        init: `(rng_key, observation, inputs) -> (state, info)`, the first frame.
        step: `(rng_key, state, observation, inputs) -> (state, info)`, each later frame.
        to_devices: `state -> state`, moves a state that comes from elsewhere, such as a file, to where `step` keeps it.
        initial_state: `(observation, inputs) -> state`, the state before the first frame, of a filter whose `step` takes it;
            nothing but `step` is then compiled.
        in_parallel: `(keys (T,), observations, () -> stacked inputs) -> (states, infos)`, all frames at once with a leading T,
            where a filter can; it returns None where frames are to be run one after the other.
        closed_form: Whether means and evidence come from a formula, without Monte Carlo error, whatever is drawn from them.
        evidence: The source of the error of the log-evidence: "weights", whose mean is a frame's evidence and whose ESS is that
            of `FilterInfo`; "runs" of several seeds alone; or "none", of a filter that has no evidence, for it seeks a mode
            and does not sample the posterior.
        points: How many points carry a posterior to the next frame, by their mixture; None if weighted particles do, whose
            effective number is in `FilterInfo`, or a distribution.
        genealogy: Whether a particle descends from the one of the frame before that `FilterInfo.ancestors` names.
        differentiable: Whether the evidence's derivative by params is that of what it estimates, and not one that leaves out
            that moves are accepted or refused.
        model: The model; None for a filter whose builder is not decorated with
            :func:`~poseppl.program.memoized_builder.memoized_builder`, which sets it.
    """

    init: Callable[[Array, Any, Any], tuple[Any, FilterInfo]]
    step: Callable[[Array, Any, Any, Any], tuple[Any, FilterInfo]]
    to_devices: Callable[[Any], Any] = identity
    initial_state: Callable[[Any, Any], Any] | None = None
    in_parallel: Callable[[Array, Any, Callable[[], Any]], tuple[Any, FilterInfo] | None] | None = None
    closed_form: bool = False
    evidence: EvidenceError = "runs"
    points: int | None = None
    genealogy: bool = False
    differentiable: bool = True
    model: CompiledModel | None = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("init", "step"):
            object.__setattr__(self, name, with_full_precision(getattr(self, name)))

    @property
    def is_optimizer(self) -> bool:
        """Whether it seeks a mode, and its intervals mean nothing."""
        return self.evidence == "none"

    @property
    def provenance(self) -> dict[str, Any]:
        """Attributes of a result that describe the filter, for diagnostics."""
        properties = {"closed form": self.closed_form, "evidence": self.evidence}
        return properties if self.points is None else {**properties, "points of the past": self.points}


def filter_of_steps(
    initial_state: Callable[[Any, Any], Any], step: Callable[[Array, Any, Any, Any], tuple[Any, FilterInfo]], **properties: Any
) -> Filter:
    """A filter whose first frame is a step from the state before it.

    Args:
        initial_state: The field of :class:`Filter`.
        step: Likewise.
        properties: Other fields.
    """

    def init(rng_key: Array, observation: Any, inputs: Any = None) -> tuple[Any, FilterInfo]:
        return step(rng_key, initial_state(observation, inputs), observation, inputs)

    return Filter(init, step, initial_state=initial_state, **properties)
