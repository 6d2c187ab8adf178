r"""The switching Gaussian filter: a Gaussian for each value of a finite site, found by iterated linearisation.

The interacting multiple model of Blom and Bar-Shalom (1988, doi:10.1109/9.1299). For a state (k, x), k of K values, the past is

    p(k_(t-1) = i, x_(t-1) | z_1..(t-1)) ~ w_i N(m_i, P_i),

and for each k_t = j

1. the pasts that lead to j are mixed and their moments matched, with weights w_i A_ij;
2. the mixture is propagated by the transition given j, linearised at its mean;
3. the data are taken in at the mode, found by Gauss-Newton steps, with Laplace's approximation of their density:
   the new w_j is proportional to it times sum_i w_i A_ij.

Exact where programs are linear and Gaussian given k and x_t depends on k_t alone, not on x_(t-1); otherwise approximate, for
step 1 keeps two moments of the past. Without a finite site, K = 1, it is an iterated extended Kalman filter. Its particles are
draws.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least
from poseppl.compilation import jit
from poseppl.errors import UnsuitableModelError
from poseppl.filters.base import Filter, FilterInfo, filter_info, filter_of_steps
from poseppl.filters.conditional_proposal import conditional_model
from poseppl.gaussians.marginals import Marginals
from poseppl.particles.weights import normalise
from poseppl.program import Clamped, CompiledModel, Observation
from poseppl.program.bijector import integer_bounds
from poseppl.program.memoized_builder import memoized_builder


class SwitchingState(NamedTuple):
    """Draws, and the Gaussians that they are of.

    Attributes:
        particles: Flat states (N, d).
        log_weights: Normalised log-weights (N,), all alike.
        log_masses: Log-probabilities of the K values (K,).
        means: Means of the real coordinates given each (K, r).
        scales: Square roots of their covariances (K, r, r).
        marginals: The mixture of the Gaussians, of all coordinates.
        started: Whether there has been a frame, a boolean; before the first one the Gaussians are those of the initial program.
    """

    particles: Array
    log_weights: Array
    log_masses: Array
    means: Array
    scales: Array
    marginals: Marginals
    started: Array


@memoized_builder
def switching_filter(model: CompiledModel, num_particles: int = 1000, *, num_iterations: int = 4) -> Filter:
    """The switching Gaussian filter: a Gaussian for each value of a finite site, by iterated linearisation.

    Args:
        model: The compiled model, with one finite site at most and Gaussian moments of its real sites given that.
        num_particles: N that stand for the posterior.
        num_iterations: Gauss-Newton steps of a frame, at least 1.

    Returns:
        The filter; its state is :class:`SwitchingState`. Evidence and means are approximations without Monte Carlo error.

    Raises:
        ValueError: A number below 1.
        UnsuitableModelError: The model has several finite sites.
    """
    check_at_least(1, num_particles=num_particles, num_iterations=num_iterations)
    switch = _Switch.of_model(model)

    def update(
        rng_key: Array, log_prior: Array, prior: _Gaussians, before: Array, observation: Observation, inputs: Any
    ) -> tuple[SwitchingState, FilterInfo]:
        def one(value: Array, mean: Array, scale: Array, before: Array) -> _Updated:
            return _update(switch.real, mean, scale, observation, switch.given(value, before, inputs), num_iterations)

        after = jax.vmap(one)(switch.values, *prior, before)
        evidence = jnp.where(jnp.isfinite(after.log_evidence), after.log_evidence, -jnp.inf)
        weighed = normalise(log_prior + evidence)
        failed = weighed.degenerate
        masses = jnp.where(failed, log_prior, weighed.log_weights)
        means, scales = (jnp.where(failed, old, new) for old, new in zip(prior, (after.mean, after.scale), strict=True))
        particles = switch.draw(rng_key, num_particles, masses, _Gaussians(means, scales))
        total = jnp.where(failed, -jnp.inf, jax.nn.logsumexp(log_prior + evidence))
        count = len(masses) * (num_iterations + 1)
        info = filter_info(total, num_particles, num_particles, failed, num_likelihood=count, num_gradient=count)
        return state_of(particles, masses, means, scales, started=True), info

    def state_of(particles: Array, masses: Array, means: Array, scales: Array, *, started: bool) -> SwitchingState:
        uniform = jnp.full(num_particles, -jnp.log(num_particles), particles.dtype)
        marginals = switch.marginals(masses, _Gaussians(means, scales))
        return SwitchingState(particles, uniform, masses, means, scales, marginals, jnp.asarray(started))

    @jit  # one program instead of one for each of its operations
    def initial_state(observation: Observation, inputs: Any = None) -> SwitchingState:
        blank = jnp.zeros((len(switch.values), model.dimension))

        def first(value: Array, blank: Array) -> tuple[Array, Array, Array]:
            given = switch.given(value, blank, inputs)
            mean, covariance = switch.real.initial_moments(given)
            chance = model.log_initial(switch.state(value, mean), inputs) - switch.real.log_initial(mean, given)
            return chance, mean, jnp.linalg.cholesky(covariance)

        log_prior, means, scales = jax.vmap(first)(switch.values, blank)
        particles = jnp.zeros((num_particles, model.dimension), means.dtype)
        return state_of(particles, log_prior, means, scales, started=False)

    def step(
        rng_key: Array, state: SwitchingState, observation: Observation, inputs: Any = None
    ) -> tuple[SwitchingState, FilterInfo]:
        blank = state.log_masses, state.means, state.scales, jnp.zeros((len(switch.values), model.dimension))
        # before the first frame the prediction from the initial Gaussians is finite like them, and is not chosen
        predicted = jax.tree.map(partial(jnp.where, state.started), _predict(model, switch, state, inputs), blank)
        log_prior, mean, scale, before = predicted
        return update(rng_key, log_prior, _Gaussians(mean, scale), before, observation, inputs)

    return filter_of_steps(initial_state, step, closed_form=True)


class _Gaussians(NamedTuple):
    """Means (K, r) and square roots of covariances (K, r, r)."""

    means: Array
    scales: Array


class _Updated(NamedTuple):
    """A Gaussian that has taken in the data, and the log-density of these."""

    mean: Array
    scale: Array
    log_evidence: Array


class _Switch(NamedTuple):
    """A model's finite site: its model given that, its values (K,), its column and those of the real coordinates (r,)."""

    real: CompiledModel
    values: Array
    column: int | None
    columns: np.ndarray[Any, Any]

    @classmethod
    def of_model(cls, model: CompiledModel) -> _Switch:
        columns = np.flatnonzero(~np.asarray(model.finite_coordinates))
        if not model.finite_sites:
            return cls(model, jnp.zeros(1), None, columns)
        site = model.sites[model.finite_sites[0]]
        bounds = integer_bounds(site.support)
        if len(model.finite_sites) > 1 or site.size > 1 or bounds is None:
            names = list(model.finite_sites)
            raise UnsuitableModelError(
                f"The model has the finite sites {names}. Expected a single one, Categorical or Bernoulli."
            )
        values = jnp.arange(bounds[0], bounds[1] + 1, dtype=jnp.result_type(float))
        return cls(conditional_model(model), values, site.offset, columns)

    def state(self, value: Array, real: Array) -> Array:
        """A whole state (d,)."""
        if self.column is None:
            return real
        return jnp.zeros(len(self.columns) + 1, real.dtype).at[self.columns].set(real).at[self.column].set(value)

    def given(self, value: Array, before: Array, inputs: Any) -> Any:
        """Inputs of the real model, with the value of this frame and the state before it."""
        if self.column is None:
            return inputs
        return Clamped(inputs, jnp.zeros_like(before).at[self.column].set(value), before)

    def marginals(self, log_masses: Array, gaussians: _Gaussians) -> Marginals:
        """The mixture of the Gaussians, with their finite values."""
        means = jax.vmap(self.state)(self.values, gaussians.means)
        variances = jnp.sum(jnp.square(gaussians.scales), 2)
        return Marginals(log_masses, means, jnp.zeros_like(means).at[:, self.columns].set(variances))

    def draw(self, rng_key: Array, count: int, log_masses: Array, gaussians: _Gaussians) -> Array:
        key_value, key_noise = jax.random.split(rng_key)
        chosen = jax.random.categorical(key_value, log_masses, shape=(count,))
        noise = jax.random.normal(key_noise, (count, len(self.columns)), gaussians.means.dtype)
        real = gaussians.means[chosen] + jnp.einsum("nij,nj->ni", gaussians.scales[chosen], noise)
        states: Array = jax.vmap(self.state)(self.values[chosen], real)
        return states


def _predict(model: CompiledModel, switch: _Switch, state: SwitchingState, inputs: Any) -> tuple[Array, Array, Array, Array]:
    """Steps 1 and 2: log-probabilities (K,), means (K, r), scales (K, r, r), and the state before that each rests on."""
    pasts = jax.vmap(switch.state)(switch.values, state.means)

    def chance(value: Array, past: Array) -> Array:
        given, before = switch.given(value, past, inputs), past[switch.columns]
        x = switch.real.transition_moments(before, given)[0]
        return model.log_transition(switch.state(value, x), past, inputs) - switch.real.log_transition(x, before, given)

    def predict(value: Array) -> tuple[Array, Array, Array, Array]:
        joint = state.log_masses + jax.vmap(lambda past: chance(value, past))(pasts)
        mean, covariance = _mixed(jax.nn.softmax(joint), state.means, state.scales)
        # the transition given the value: the likeliest past stands for what it was
        before = switch.state(switch.values[jnp.argmax(joint)], mean)
        given = switch.given(value, before, inputs)
        centre, noise = switch.real.transition_moments(mean, given)
        slope = jax.jacfwd(lambda x: switch.real.transition_moments(x, given)[0])(mean)
        return jax.nn.logsumexp(joint), centre, jnp.linalg.cholesky(slope @ covariance @ slope.T + noise), before

    return jax.vmap(predict)(switch.values)


def _mixed(weights: Array, means: Array, scales: Array) -> tuple[Array, Array]:
    """Mean (r,) and covariance (r, r) of a mixture."""
    mean = weights @ means
    apart = means - mean
    covariance = jnp.einsum("k,kij,klj->il", weights, scales, scales) + jnp.einsum("k,ki,kj->ij", weights, apart, apart)
    return mean, covariance


def _update(
    model: CompiledModel, mean: Array, scale: Array, observation: Observation, inputs: Any, num_iterations: int
) -> _Updated:
    """Take in data in the coordinates u of x = mean + scale u, whose prior is N(0, 1)."""
    eye = jnp.eye(len(mean), dtype=mean.dtype)

    def curvature(x: Array) -> Array:
        information = model.observation_information(x, observation, inputs)
        factor: Array = jnp.linalg.cholesky(eye + scale.T @ information @ scale)
        return factor

    def descend(_: int, u: Array) -> Array:
        x = mean + scale @ u
        gradient = scale.T @ jax.grad(model.log_observation)(x, observation, inputs) - u
        moved = u + jax.scipy.linalg.cho_solve((curvature(x), True), gradient)
        return jnp.where(jnp.all(jnp.isfinite(moved)), moved, u)

    u = jax.lax.fori_loop(0, num_iterations, descend, jnp.zeros_like(mean))
    x = mean + scale @ u
    factor = curvature(x)
    root = jax.scipy.linalg.solve_triangular(factor, eye, lower=True).T
    log_density = model.log_observation(x, observation, inputs) - 0.5 * u @ u - jnp.sum(jnp.log(jnp.diagonal(factor)))
    return _Updated(x, scale @ root, log_density)
