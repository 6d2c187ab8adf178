r"""The ensemble Kalman filter (Evensen 1994, doi:10.1029/94JC00572): a Gaussian known by N members, for high dimension.

At each frame

1. every member moves by a draw from the transition, which may be any program over the real line;
2. the deviations from the members' mean are inflated, where asked;
3. the members take in the data by Kalman's update with sampled covariances (:mod:`poseppl.gaussians.ensemble`).

In the square-root form step 3 is exact in the members' mean and covariance; in the stochastic form each member has perturbed
data, and members keep more of a shape that is not Gaussian. No covariance of the state is made, (d, d) or inverted: the cost is
that of N transitions and one Cholesky factor of the data's covariance. On linear Gaussian models members converge to Kalman's
answer with N; on others the update is linear, as a Kalman filter's.

With few members for the directions in which the state spreads, covariances need localisation (data move what is near,
:mod:`poseppl.gaussians.localisation`) and inflation, for errors in the gain make the members too narrow on average. Inflation
is a factor of the prediction's standard deviation, fixed or adapted to the innovations (Li, Kalnay and Miyoshi 2009; Miyoshi
2011); relaxation gives the posterior back a share of the spread that the data took (Whitaker and Hamill 2012).

The evidence is that of the members' Gaussian, N(y; mean h, S).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_choice, check_fraction
from poseppl.errors import UnsuitableModelError
from poseppl.filters.base import Filter, FilterInfo, filter_info, filter_of_steps
from poseppl.gaussians.ensemble import (
    Form,
    Increment,
    PredictedData,
    adapted_inflation,
    increment,
    inflated,
    moved,
    predicted_data,
    relaxed,
)
from poseppl.gaussians.localisation import Localisation, check_localisation
from poseppl.particles.keys import particle_keys
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, propagate

_DRIFT = 0.04
"""Standard deviation by which an adaptive factor of the covariance may change from frame to frame, as in Miyoshi 2011."""


class EnsembleState(NamedTuple):
    """The members.

    Attributes:
        particles: Members (N, d).
        log_weights: Log-weights (N,), all -log N.
        inflation: Factor of the next prediction's standard deviation, a scalar.
        started: Whether there has been a frame, a boolean.
    """

    particles: Array
    log_weights: Array
    inflation: Array
    started: Array


class Analysis(NamedTuple):
    """A frame of the filter.

    Attributes:
        state: The state after it.
        info: Its diagnosis.
        by: The update by the data, with no weights where they were impossible; smoothers apply it to earlier frames.
    """

    state: EnsembleState
    info: FilterInfo
    by: Increment


class EnsembleSettings(NamedTuple):
    """Settings of the filter, as in :func:`ensemble_kalman_filter`."""

    num_particles: int
    form: Form
    inflation: float
    adaptive: bool
    relaxation: float
    localisation: Localisation | None

    def check(self, model: CompiledModel) -> EnsembleSettings:
        """These settings.

        Raises:
            ValueError: A setting out of its range, or tapers that are not for this model.
            UnsuitableModelError: The model has finite sites.
        """
        check_at_least(2, num_particles=self.num_particles)
        check_choice(Form, form=self.form)
        check_fraction("[0, 1]", relaxation=self.relaxation)
        if not self.inflation >= 1:
            raise RangeError("inflation", self.inflation, "a factor of at least 1")
        if model.finite_sites:
            raise UnsuitableModelError(
                f"The model has the finite sites {list(model.finite_sites)}, which no Gaussian describes. Use a switching, a "
                "particle or a tempered filter."
            )
        return self if self.localisation is None else self._replace(localisation=check_localisation(model, self.localisation))


@memoized_builder
def ensemble_kalman_filter(
    model: CompiledModel,
    num_particles: int = 100,
    *,
    form: Form = "square-root",
    inflation: float = 1.0,
    adaptive: bool = False,
    relaxation: float = 0.0,
    localisation: Localisation | None = None,
) -> Filter:
    """The ensemble Kalman filter: one Gaussian, known by its members; for hundreds of coordinates.

    Args:
        model: The compiled model, without finite sites, its observation with Gaussian moments given the state.
        num_particles: N, members of the ensemble, at least 2.
        form: "square-root", which draws nothing for the data, or "stochastic", with perturbed data.
        inflation: Factor of the prediction's standard deviation, at least 1; where it is adaptive, that of the first frame.
        adaptive: Whether the innovations adapt the inflation.
        relaxation: Share of the spread that the data took which is given back, in [0, 1].
        localisation: Tapers of sampled covariances, from :func:`~poseppl.gaussians.localisation.localise_by_position`,
            :func:`~poseppl.gaussians.localisation.localise_by_name` or arrays of yours.

    Returns:
        The filter; its state is :class:`EnsembleState`.

    Raises:
        ValueError: A setting out of its range, or tapers that are not for this model.
        UnsuitableModelError: The model has finite sites; or, when the filter is traced, its observation has no moments.
    """
    settings = EnsembleSettings(num_particles, form, inflation, adaptive, relaxation, localisation).check(model)

    def start(observation: Observation, inputs: Any = None) -> EnsembleState:
        return initial_state(model, settings)

    def step(
        rng_key: Array, state: EnsembleState, observation: Observation, inputs: Any = None
    ) -> tuple[EnsembleState, FilterInfo]:
        return analyse(model, settings, rng_key, state, observation, inputs)[:2]

    return filter_of_steps(start, step)


def initial_state(model: CompiledModel, settings: EnsembleSettings) -> EnsembleState:
    """The state before the first frame."""
    members = jnp.zeros((settings.num_particles, model.dimension))
    log_weights = jnp.full(settings.num_particles, -jnp.log(settings.num_particles), members.dtype)
    return EnsembleState(members, log_weights, jnp.asarray(settings.inflation, members.dtype), jnp.zeros((), bool))


def analyse(
    model: CompiledModel,
    settings: EnsembleSettings,
    rng_key: Array,
    state: EnsembleState,
    observation: Observation,
    inputs: Any,
) -> Analysis:
    """Predict a frame and take in its data."""
    key_draw, key_data = jax.random.split(rng_key)
    keys = particle_keys(key_draw, settings.num_particles)
    members = jax.lax.cond(
        state.started,
        lambda: propagate(model, keys, state.particles, inputs),
        lambda: draw_initial(model, keys, inputs),
    )
    inflates = settings.adaptive or settings.inflation != 1
    prior = inflated(members, state.inflation) if inflates else members
    predicted = _compare(model, prior, observation, inputs)
    by = increment(key_data, predicted, settings.form, _taper(settings.localisation, "data"))
    posterior = moved(prior, by, _taper(settings.localisation, "states"))
    if settings.relaxation:
        posterior = relaxed(posterior, prior, settings.relaxation)
    failed = ~(jnp.isfinite(by.log_evidence) & jnp.all(jnp.isfinite(posterior)))
    posterior = jnp.where(failed, prior, posterior)
    factor = state.inflation
    if settings.adaptive:
        bare = _compare(model, members, observation, inputs)
        factor = jnp.where(failed, factor, adapted_inflation(factor, bare, _DRIFT))
    count = settings.num_particles
    log_evidence = jnp.where(failed, -jnp.inf, by.log_evidence)
    info = filter_info(log_evidence, count, count, failed, num_likelihood=count)
    kept = Increment(*(jnp.where(failed, 0.0, part) for part in by))
    return Analysis(EnsembleState(posterior, state.log_weights, factor, jnp.ones((), bool)), info, kept)


def _compare(model: CompiledModel, members: Array, observation: Observation, inputs: Any) -> PredictedData:
    means, noises = jax.vmap(lambda x: model.observation_moments(x, inputs))(members)
    return predicted_data(means, noises, *model.flat_observation(observation))


def _taper(localisation: Localisation | None, name: str) -> Array | None:
    return None if localisation is None else jnp.asarray(getattr(localisation, name), jnp.result_type(float))
