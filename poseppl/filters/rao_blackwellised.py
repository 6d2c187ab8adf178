r"""The Rao-Blackwellised particle filter for switching models (Doucet, de Freitas, Murphy and Russell 2000, arXiv:1301.3853).

If the real coordinates are Gaussian given the finite sites, only the finite sites are sampled: particle i is a history of
their values and the Gaussian N(m_i, P_i) that a Kalman filter finds along it,

    p(k_0..t, x_t | z_1..t)  ~  sum over i of w_i delta(k_0..t = k^(i)) N(x_t; m_i, P_i).

At each frame ancestors are drawn by weight. Each child draws k_t from the transition given its ancestor's k_(t-1), moves its
Gaussian by the transition given both values and conditions it on the data. Its weight is multiplied by the evidence of the
data. No moments are matched: unlike the switching filter's (:mod:`poseppl.filters.switching`), the answer is exact in the limit
of many particles, and the evidence is unbiased, where programs are linear and Gaussian given the finite sites. Otherwise they
are linearised, as by an extended Kalman filter, and the limit is that approximation.

Which sites are finite, and what is left given them, is read from the program. Means and quantiles are those of the mixture;
particles are draws, one of each Gaussian.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.errors import UnsuitableModelError
from poseppl.filters.adaptive_resampling import Ancestry, adaptive_resampling
from poseppl.filters.base import Filter, FilterInfo, filter_info
from poseppl.filters.conditional_proposal import conditional_model
from poseppl.filters.kalman import update
from poseppl.gaussians.gaussian import Gaussian
from poseppl.gaussians.linearisation import first_order, predict
from poseppl.gaussians.marginals import Marginals
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import Scheme
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import weigh
from poseppl.program import Clamped, CompiledModel, Observation
from poseppl.program.dependence import output_dependence
from poseppl.program.execution import sample_sites, trace_program
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import differentiable_draws, draw_initial, propagate


class CollapsedState(NamedTuple):
    """Weighted histories of finite values, each with its Gaussian.

    Attributes:
        particles: Flat states (N, d): the finite values, and a draw from the Gaussian.
        log_weights: Normalised log-weights (N,).
        real: Means (N, r) and covariances (N, r, r) of the real coordinates.
        marginals: The mixture of all particles' Gaussians.
    """

    particles: Array
    log_weights: Array
    real: Gaussian
    marginals: Marginals


@memoized_builder
def rao_blackwellised_filter(
    model: CompiledModel, num_particles: int = 500, *, resampling: Scheme = "systematic", ess_threshold: float = 0.5
) -> Filter:
    """The Rao-Blackwellised particle filter: finite sites are sampled, and the rest is a Gaussian given them.

    Args:
        model: The compiled model, its finite sites independent of the real ones, its real sites and data with Gaussian moments
            given the finite ones.
        num_particles: N, at least 1.
        resampling: How ancestors are drawn.
        ess_threshold: Resample when ESS <= threshold * N: 1 at every frame, 0 never.

    Returns:
        The filter; its state is :class:`CollapsedState`.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
        UnsuitableModelError: When the filter is traced: a finite site depends on a real one, or a program has no moments.
    """
    adaptive = adaptive_resampling(num_particles, resampling, ess_threshold)
    split = _Split.of_model(model)

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[CollapsedState, FilterInfo]:
        key_finite, key_real = jax.random.split(rng_key)
        split.check("initial", inputs)
        drawn = draw_initial(model, particle_keys(key_finite, num_particles), inputs)
        drawn, score = differentiable_draws(model, drawn, None, inputs)
        given = split.given(drawn, drawn, inputs)
        first = split.of_each(lambda _, given: Gaussian(*split.real.initial_moments(given)))
        prior = first(drawn, given)  # inputs may be None
        uniform = jnp.full(num_particles, -jnp.log(num_particles), drawn.dtype)
        return taken_in(key_real, drawn, prior, given, adaptive.keep(uniform + score), observation)

    def step(
        rng_key: Array, state: CollapsedState, observation: Observation, inputs: Any = None
    ) -> tuple[CollapsedState, FilterInfo]:
        key_resample, key_finite, key_real = jax.random.split(rng_key, 3)
        split.check("transition", inputs)
        ancestry = adaptive.choose(key_resample, state.log_weights)
        before, past = state.particles[ancestry.ancestors], tree_index(state.real, ancestry.ancestors)
        drawn = propagate(model, particle_keys(key_finite, num_particles), before, inputs)
        drawn, score = differentiable_draws(model, drawn, before, inputs)
        ancestry = ancestry._replace(log_weights=ancestry.log_weights + score)
        given = split.given(drawn, before, inputs)

        def move(past: Gaussian, given: Any) -> Gaussian:
            return predict(past, first_order(lambda x: split.real.transition_moments(x, given), past.mean))

        return taken_in(key_real, drawn, split.of_each(move)(past, given), given, ancestry, observation)

    def taken_in(
        rng_key: Array, drawn: Array, prior: Gaussian, given: Any, ancestry: Ancestry, observation: Observation
    ) -> tuple[CollapsedState, FilterInfo]:
        condition = split.of_each(lambda prior, given: update(split.real, prior, observation, given, "first-order"))
        real, log_evidence, _ = condition(prior, given)
        weighed = weigh(ancestry.log_weights, log_evidence)
        noise = jax.random.normal(rng_key, real.mean.shape, real.mean.dtype)
        drawn_means = real.mean + jnp.einsum("nij,nj->ni", jnp.linalg.cholesky(real.covariance), noise)
        particles = drawn.at[:, split.columns].set(drawn_means)
        info = filter_info(
            weighed.log_evidence,
            jnp.minimum(ancestry.ess, weighed.ess),
            ancestry.ancestors,
            weighed.failed,
            num_likelihood=num_particles,
            num_gradient=num_particles,
        )
        return CollapsedState(particles, weighed.log_weights, real, split.marginals(weighed.log_weights, drawn, real)), info

    return Filter(init, step, evidence="weights")


class _Split(NamedTuple):
    """A model, that of its real coordinates given the finite ones, and the columns of the real ones."""

    model: CompiledModel
    real: CompiledModel
    columns: np.ndarray[Any, Any]

    @classmethod
    def of_model(cls, model: CompiledModel) -> _Split:
        columns = np.flatnonzero(~np.asarray(model.finite_coordinates))
        return cls(model, conditional_model(model) if model.finite_sites else model, columns)

    def given(self, x: Array, before: Array, inputs: Any) -> Any:
        """Inputs of the real model, with the finite values (N, d) of this frame and the one before."""
        return Clamped(inputs, x, before) if self.model.finite_sites else inputs

    def of_each(self, function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """A function of each particle's rows and what is given of it; the frame's own inputs are one for all."""
        return jax.vmap(function, in_axes=(0, Clamped._make((None, 0, 0)) if self.model.finite_sites else None))

    def marginals(self, log_weights: Array, drawn: Array, real: Gaussian) -> Marginals:
        """Gaussians (N, r) of the real coordinates beside finite values, those of states (N, d)."""
        variances = jnp.diagonal(real.covariance, axis1=1, axis2=2)
        means = drawn.at[:, self.columns].set(real.mean)
        return Marginals(log_weights, means, jnp.zeros_like(drawn).at[:, self.columns].set(variances))

    def check(self, which: str, inputs: Any) -> None:
        """Refuse finite sites that depend on real ones, whose values no particle has.

        Raises:
            UnsuitableModelError: There is one.
        """
        model = self.model
        if not model.finite_sites:
            return
        example = {name: jnp.zeros(site.shape, site.dtype) for name, site in model.sites.items()}

        def laws(before: dict[str, Array], now: dict[str, Array]) -> list[Any]:
            arguments = model._bound(), *(() if which == "initial" else (before,)), inputs
            trace = sample_sites(trace_program(getattr(model.programs, which), arguments, values=now))
            return [jax.tree.leaves(trace[name]["fn"]) for name in model.finite_sites]

        labels = [frozenset(() if name in model.finite_sites else (0,)) for name in sorted(example)]
        reached = output_dependence(jax.make_jaxpr(laws)(example, example), labels * 2)
        if any(reached):
            raise UnsuitableModelError(
                f"A finite site of the {which} program, one of {list(model.finite_sites)}, depends on real ones, so that these "
                "are no Gaussian given it. Use a particle or a guided filter."
            )
