r"""Predictive checks, which need no truth: each frame's data against what the filter expected before it saw them.

S independent draws of x_(t-1) from the filter's state after frame t - 1 are moved by the transition. They give S replicates
y^(s) of the data of frame t, for any filter. If the filter's posterior and the model are right, the data z_t and the replicates
are S + 1 exchangeable draws. Ranks among them are then exactly uniform for any S (Dawid 1984, doi:10.2307/2981683; for counts
randomised, Czado, Gneiting and Held 2009, doi:10.1111/j.1541-0420.2009.01191.x):

* the probability integral transform of each entry,  u = (#{y < z} + U (#{y = z} + 1)) / (S + 1),  U uniform in (0, 1);
* the rank of the innovation chi-square  (z - m)' C^-1 (z - m),  with m and C from one half of the replicates, among the others.

The result also contains the innovation z - m and its expected variance in two parts: the variance of E[y | x] over the states,
and the mean of Var[y | x]. The first part is the filter's uncertainty of the state, and agrees with the errors of a calibrated
filter (:mod:`poseppl.diagnostics.predictive`). Masked entries are NaN. For the state itself the result contains its predicted
moments, and the share of its variance that the data can explain, by the scores of the replicates. It also contains the moments
of the predicted states weighted by the frame's likelihood. A filter's posterior has to agree with these
(:mod:`poseppl.diagnostics.unreached`, :mod:`poseppl.diagnostics.predictive`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least
from poseppl.filters.base import FilterState
from poseppl.filters.scan import Predict as Predict
from poseppl.gaussians.gaussian import lower_inverse
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import multinomial
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, log_likelihoods, propagate

_MAX_JOINT = 400
"""Entries of a frame's data up to which the chi-square knows their covariances."""
_MAX_MEMORY = 10
"""Largest number of coordinates whose memory is reported."""
_MAX_TRANSFER = 40
"""Largest number of coordinates for which the transfer of errors is computed; above ten by the data's information."""
_STRATA = 20
"""Draws that are kept of the weighted states."""
_RIDGE = 1e-4
"""Added to the diagonal of correlations: states that hardly differ leave a singular matrix."""
_MIN = 1e-30
"""Least variance of an entry."""


class DataPrediction(NamedTuple):
    """A frame's data against their prediction; of a sequence, with a leading T.

    Attributes:
        transform: Probability integral transform (k,) of each entry, in the order of the model's `flat_observation`.
        innovation: Data minus their predicted mean (k,).
        state_variance: Variance (k,) of E[y | x] over the predicted states.
        noise_variance: Mean (k,) of Var[y | x] over the predicted states.
        chi_square: Innovation chi-square over its mean under the prediction, a scalar.
        chi_square_transform: Its randomised rank, a scalar in (0, 1).
        state_share: Share of its mean that is of the predicted states' variance, a scalar; the rest is the data's noise.
    """

    transform: Any
    innovation: Any
    state_variance: Any
    noise_variance: Any
    chi_square: Any
    chi_square_transform: Any
    state_share: Any = None


class StatePrediction(NamedTuple):
    """The state that a frame's data were predicted from; of a sequence, with a leading T.

    Attributes:
        predicted_mean: Mean (d,) of the predicted states.
        predicted_variance: Their variance (d,) by coordinate.
        predicted_error: Monte Carlo standard error (d,) of `predicted_mean`.
        autoregression: Slope (d,) of each predicted coordinate on itself in the frame before.
        explained: Share (d,) of `predicted_variance` that the frame's data can take away, by their Fisher information;
            NaN of finite sites.
        weighted_mean: Mean (d,) of the predicted states, weighted by the likelihood of the frame's data. This and what follows
            is None of more than ten coordinates.
        weighted_covariance: Their covariance (d, d).
        weighted_ess: Their effective number, a scalar.
        memory: Effect of an error in each coordinate of the previous frame on each coordinate of this one (d, d), after its
            data.
        weighted_draws: Twenty stratified draws (20, d) of each coordinate of them, in ascending order.
        transfer: The same as `memory`, by the data's information at the predicted mean; for 11 to 40 real coordinates.
    """

    predicted_mean: Any
    predicted_variance: Any
    predicted_error: Any
    autoregression: Any
    explained: Any
    weighted_mean: Any = None
    weighted_covariance: Any = None
    weighted_ess: Any = None
    memory: Any = None
    weighted_draws: Any = None
    transfer: Any = None


class Prediction(NamedTuple):
    """Predictive checks of a frame; of a sequence, with a leading T.

    Attributes:
        data: Its data against their prediction.
        state: Predictions of its state; None if they were not requested.
    """

    data: DataPrediction
    state: StatePrediction | None = None

    def by_name(self) -> dict[str, Any]:
        """The fields of both that there are, by their names, as in a result."""
        parts = self.data._asdict() | ({} if self.state is None else self.state._asdict())
        return {name: values for name, values in parts.items() if values is not None}

    @classmethod
    def of(cls, checks: Mapping[str, Any]) -> Prediction:
        """From the fields by name."""
        state = {name: checks[name] for name in StatePrediction._fields if name in checks}
        data = DataPrediction(**{name: checks[name] for name in DataPrediction._fields if name in checks})
        return cls(data, StatePrediction(**state) if "explained" in state else None)


@memoized_builder
def predictive_checks(model: CompiledModel, num_draws: int = 200, *, of_state: bool = True, of_points: bool = True) -> Predict:
    """Build the checks for :func:`poseppl.runs.run.run_filter`.

    Args:
        model: The model that the filter was built for.
        num_draws: S, at least 8.
        of_state: Whether to include the checks of the state's coordinates.
        of_points: Whether `transfer` is, of which only the verdict on filters that tell their `points` makes use.

    Returns:
        The checks; they raise a ValueError where the observation program has a heuristic likelihood, which predicts no data
        (`model.why_not_predictive` tells).
    """
    check_at_least(8, num_draws=num_draws)
    finite = np.array(model.finite_coordinates)

    def draw_states(keys: Array, state: FilterState, first: Any, inputs: Any) -> tuple[Array, Array]:
        key_choose, key_initial, key_move = keys
        chosen = multinomial(key_choose, jnp.ravel(state.log_weights), num_draws)
        previous = state.particles.reshape(-1, state.particles.shape[-1])[chosen]
        moved = propagate(model, particle_keys(key_move, num_draws), previous, inputs)
        initial = draw_initial(model, particle_keys(key_initial, num_draws), inputs)
        return jnp.where(first, initial, previous), jnp.where(first, initial, moved)

    def predict(rng_key: Array, state: FilterState, first: Any, observation: Observation, inputs: Any) -> Prediction:
        keys = jax.random.split(rng_key, 5)
        previous, states = draw_states(keys[:3], state, first, inputs)
        drawn = jax.vmap(lambda key, x: model.draw_data(key, x, inputs))(jax.random.split(keys[3], num_draws), states)

        # a distribution that tells no moments counts as all noise of the state
        known = jnp.isfinite(drawn.mean) & jnp.isfinite(drawn.variance)
        means, variances = jnp.where(known, drawn.mean, drawn.values), jnp.where(known, drawn.variance, 0.0)
        data, seen = model.flat_observation(observation)
        chances = jax.random.uniform(keys[4], (data.shape[0] + 2,), data.dtype)
        whole, ties, offset = chances[0], chances[1:-1], chances[-1]
        chi_square, share = _chi_square(means, variances, data, seen)
        half = num_draws // 2
        all_found = chi_square(jnp.concatenate([data[None], drawn.values[half:]]))
        found, others = all_found[0], all_found[1:]
        entries = (
            _rank(ties, drawn.values, data),
            data - jnp.mean(means, 0),
            jnp.var(means, 0, ddof=1),
            jnp.mean(variances, 0),
        )
        scores = found / jnp.mean(others), _rank(whole, others, found), share
        transform, innovation, state_variance, noise_variance = (jnp.where(seen, entry, jnp.nan) for entry in entries)
        of_frame = (jnp.where(jnp.any(seen), value, jnp.nan) for value in scores)
        of_data = DataPrediction(transform, innovation, state_variance, noise_variance, *of_frame)
        if not of_state:
            return Prediction(of_data)

        def score(replicate: Any, x: Array) -> Array:
            data = Observation(replicate, observation.mask)
            gradient: Array = jax.grad(lambda x: model.log_observation(x, data, inputs))(x)
            return gradient

        slopes, left = _autoregression(previous, states), None
        if of_points and _MAX_MEMORY < len(finite) <= _MAX_TRANSFER and not finite.any():
            left = _left(states, model.observation_information(jnp.mean(states, 0), observation, inputs)) * slopes
        of_states = StatePrediction(
            predicted_mean=jnp.mean(states, 0),
            predicted_variance=jnp.var(states, 0, ddof=1),
            predicted_error=jnp.std(states, 0, ddof=1) / np.sqrt(num_draws),
            autoregression=slopes,
            # the scores of finite sites are no derivatives
            explained=jnp.where(finite, jnp.nan, _explained(states, jax.vmap(score)(drawn.sites, states))),
            **_weighted(previous, states, log_likelihoods(model, states, observation, inputs), offset),
            transfer=left,
        )
        return Prediction(of_data, of_states)

    return predict


def _weighted(previous: Array, states: Array, log_weights: Array, offset: Array) -> dict[str, Array]:
    """Moments and draws of states (S, d) with log-weights (S,), and the memory of those before.

    Moments are without the bias of few weights. Draws are stratified, the `offset` in (0, 1) being the place in a stratum.

    An error e in the state before is one of A e in the prediction, A being the slopes of the states on those before. After the
    data, C P^-1 A e of it remains, with the states' covariance P, and C that of the weighted ones.
    """
    if states.shape[1] > _MAX_MEMORY:
        return {}
    weights = jax.nn.softmax(log_weights)
    ess, mean = 1 / jnp.sum(weights**2), weights @ states
    (before, scale), (after, spread) = _standardised(previous), _standardised(states)
    weighted = jnp.sqrt(weights * ess / jnp.maximum(ess - 1, _MIN))[:, None] * (states - mean) / spread
    correlation = weighted.T @ weighted
    slopes = _inverse(before.T @ before) @ before.T @ after
    left = slopes @ _inverse(after.T @ after) @ correlation * (states.shape[0] - 1)
    return {
        "weighted_mean": mean,
        "weighted_covariance": spread[:, None] * correlation * spread,
        "weighted_ess": ess,
        "memory": spread[:, None] * left.T / scale,
        "weighted_draws": _stratified(states, weights, offset),
    }


def _stratified(states: Array, weights: Array, offset: Array) -> Array:
    """Quantiles (_STRATA, d) of weighted states, each coordinate on its own."""
    ordered, masses = jax.lax.sort((states, jnp.broadcast_to(weights[:, None], states.shape)), dimension=0, num_keys=1)
    below, levels = jnp.cumsum(masses, 0), (jnp.arange(_STRATA) + offset) / _STRATA
    index = jnp.minimum(jnp.sum(below < levels[:, None, None], 1), len(states) - 1)
    return jnp.take_along_axis(ordered, index, 0)


def _standardised(states: Array) -> tuple[Array, Array]:
    """States (S, d) less their mean and over their standard deviations (d,), and these."""
    scale = jnp.maximum(jnp.std(states, 0, ddof=1), np.sqrt(_MIN))
    return (states - jnp.mean(states, 0)) / scale, scale


def _inverse(product: Array) -> Array:
    """The inverse of a matrix (d, d) of sums of products of standardised states."""
    size = product.shape[0]
    root = lower_inverse(jnp.linalg.cholesky(product + _RIDGE * (1 + jnp.trace(product)) / size * jnp.eye(size)))
    return root.T @ root


def _rank(ties: Array, draws: Array, value: Array) -> Array:
    """Randomised rank of `value` (...) among `draws` (S, ...), over S + 1; `ties` (...) are uniform in (0, 1)."""
    below, equal = jnp.sum(draws < value, 0), jnp.sum(draws == value, 0)
    return (below + ties * (equal + 1)) / (draws.shape[0] + 1)


def _chi_square(means: Array, variances: Array, data: Array, seen: Array) -> tuple[Callable[[Array], Array], Array]:
    """The innovation chi-squares (N,) of data (N, k), from the first half of the draws (S, k), and the states' share."""
    half = means.shape[0] // 2
    centre = jnp.mean(means[:half], 0)
    centred = means[:half] - centre
    noise = jnp.mean(variances[:half], 0)
    scale = jnp.sqrt(jnp.maximum(noise + jnp.sum(centred**2, 0) / (half - 1), _MIN))
    white, noise = jnp.where(seen, centred / scale, 0.0), jnp.where(seen, noise / scale**2, 0.0)
    number = jnp.maximum(jnp.sum(seen), 1)
    if data.shape[0] > _MAX_JOINT:
        return lambda y: jnp.sum(jnp.where(seen, (y - centre) / scale, 0.0) ** 2, 1), 1 - jnp.sum(noise) / number
    diagonal = jnp.where(seen, noise, 1.0) + _RIDGE
    root = lower_inverse(jnp.linalg.cholesky(white.T @ white / (half - 1) + jnp.diag(diagonal)))
    share = 1 - jnp.sum(root**2 * noise) / number
    return lambda y: jnp.sum((jnp.where(seen, (y - centre) / scale, 0.0) @ root.T) ** 2, 1), share


def _autoregression(previous: Array, states: Array) -> Array:
    """Slopes (d,) of the states (S, d) on those before."""
    centred = previous - jnp.mean(previous, 0)
    return jnp.sum(centred * states, 0) / jnp.maximum(jnp.sum(centred**2, 0), _MIN)


def _explained(states: Array, scores: Array) -> Array:
    """Share (d,) by which data of these scores (S, d) shrink the variance of states (S, d), were both Gaussian.

    1 - diag((P^-1 + J)^-1) / diag(P) with the states' covariance P and the Fisher information J, the scores' mean product. By
    Ezekiel's adjustment with the effective number of parameters, a coordinate that the data do not reach has 0 on average,
    rather than what chance correlates with it.
    """
    number = states.shape[0]
    root = jnp.linalg.qr(states - jnp.mean(states, 0), mode="r")
    rank = root.shape[0]  # that of the covariance, S where there are more coordinates than states
    signal = scores @ root.T / jnp.sqrt(number * (number - 1.0))
    # a root of I + S' S from S itself: the product would lose small differences between large numbers
    left = lower_inverse(jnp.linalg.qr(jnp.concatenate([signal, jnp.eye(rank)]), mode="r").T)
    gains = rank - jnp.sum(left**2)
    residual = jnp.sum((left @ root) ** 2, 0) / jnp.maximum(jnp.sum(root**2, 0), _MIN)
    return 1 - residual * (number - 1) / jnp.maximum(number - 1 - gains, 1.0)


def _left(states: Array, information: Array) -> Array:
    """Share of errors of states (S, d) that remains after data of information J (d, d), both Gaussian: (I + P J)^-1 (d, d)."""
    left: Array = jnp.linalg.inv(jnp.eye(states.shape[1]) + jnp.cov(states.T) @ information)
    return left
