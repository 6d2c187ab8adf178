r"""Covariance scaled sampling: a tracker of several modes (Sminchisescu and Triggs 2001, section 4; CVPR).

The posterior of a frame is a mixture of K Gaussians (c_i, mu_i, S_i), one for each mode that was found. Each goes through the
transition, linearised at its mean, and the result is the next frame's prior, section 3.4. From every mode of the prior starts
are drawn along its most uncertain directions, farther out than its covariance reaches
(:mod:`poseppl.kernels.mode_search`), and climb to modes of

    p(z_t | x) max_i c_i N(x; m_i, P_i)

under the bounds of the sites' own supports and whatever further constraints there are (:mod:`poseppl.kernels.trust_region`).
Climbs that came to the same mode count once. A mode weighs its Laplace approximation, cut off where constraints are active
(:mod:`poseppl.kernels.face_laplace`), under the prior mode that is the closest to it: the most probable one at its place. The K
best are kept. The paper optimises the likelihood and static priors alone, and the prior over time weighs what was found; here
that prior is part of what is climbed, without which a single camera leaves directions that nothing bounds.

Its rivals are settings: `num_modes=1, num_starts=1` is the tracker of a single mode, Gaussian or robust as the likelihood is;
`sampling="hypotheses"` with `num_modes=10` that of Cham and Rehg 1999 (doi:10.1109/CVPR.1999.784636).
`sampling="noise"` scatters starts by the transition's noise alone, as CONDENSATION does, which itself is
:func:`~poseppl.filters.particle_filter`.

The filter is approximate: it sees no mode that no climb ended in, and a mode is a Gaussian. Exact for linear Gaussian programs;
elsewhere its evidence is the sum of Laplace's approximations at the modes that were found, without an error that more draws
would make smaller. Its particles are draws from the modes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_choice
from poseppl.filters.base import Filter, FilterInfo, check_noise, filter_info, filter_of_steps
from poseppl.filters.published.mode_mixture import draw_modes, mode_starts, predicted_modes, prior_density
from poseppl.gaussians.mixture import GaussianMixture
from poseppl.kernels.constraints import Constraints, constraints
from poseppl.kernels.mode_search import ModeProposal, ModeSearchResult, Pattern, covariance_scaled, dynamic_noise, search_modes
from poseppl.program import CompiledModel, Observation
from poseppl.program.bounded import Bounded, bounded
from poseppl.program.memoized_builder import memoized_builder

Sampling = Literal["covariance", "hypotheses", "noise"]
PriorMode = Literal["closest", "mixture"]


class Jumps(Protocol):
    """Other states that a state may be mistaken for."""

    def __call__(self, state: Array, inputs: Any) -> Array:
        """States (n, d) for a state (d,), given the inputs of its frame."""


class ModeState(NamedTuple):
    """Modes, and draws from them.

    Attributes:
        particles: Draws (N, d).
        log_weights: Log-weights (N,), all -log N.
        modes: K Gaussians in bounded coordinates (:mod:`poseppl.program.bounded`), log-weights normalised, -inf where fewer
            modes were found.
        started: Whether there has been a frame, a boolean; before the first one `modes` stand for nothing.
    """

    particles: Array
    log_weights: Array
    modes: GaussianMixture
    started: Array


@memoized_builder
def covariance_scaled_filter(
    model: CompiledModel,
    num_particles: int = 1000,
    *,
    num_modes: int = 7,
    num_starts: int = 60,
    num_directions: int = 6,
    stretch: float = 10.0,
    sampling: Sampling = "covariance",
    pattern: Pattern = "regular",
    prior: PriorMode = "closest",
    num_steps: int = 20,
    limits: Constraints | None = None,
    jumps: Jumps | None = None,
) -> Filter:
    """Covariance scaled sampling: several modes, sought along the most uncertain directions and followed under constraints.

    Args:
        model: The compiled model; its initial and transition programs have Gaussian moments, or those of sites with bounds.
        num_particles: N, draws from each frame's modes.
        num_modes: K, modes that are kept.
        num_starts: States that climb to modes in a frame: the means of the K prior modes, and the rest by their weights.
        num_directions: k, most uncertain directions along which starts lie, in units of the transition's standard deviations.
        stretch: s, factor of the covariance, or of the noise where that is what is inflated.
        sampling: How starts are drawn: "covariance", "hypotheses" or "noise".
        pattern: "regular", on the axes of the covariance, or "random"; noise is always random.
        prior: "closest" weighs a mode by the prior mode closest to it, "mixture" by all of them.
        num_steps: Steps of each climb at most.
        limits: Constraints beside those of the sites' supports, in bounded coordinates.
        jumps: Other states to start from, every second one, such as `poseppl.motion.geometry.kinematic_jumps`.

    Returns:
        The filter; its state is :class:`ModeState`.

    Raises:
        UnsuitableModelError: A site of the state has no noise.
        ValueError: A number below 1, fewer starts than modes, an unknown word, or a discrete site.
    """
    check_noise(model)
    check_at_least(1, num_particles=num_particles, num_modes=num_modes, num_directions=num_directions, num_steps=num_steps)
    check_at_least(num_modes, num_starts=num_starts)
    check_choice(Sampling, sampling=sampling)
    check_choice(Pattern, pattern=pattern)
    check_choice(PriorMode, prior=prior)
    if not stretch > 0:
        raise RangeError("stretch", stretch, "a positive number")
    boxed = bounded(model)

    def proposal(number: int, noise: Array) -> ModeProposal:
        if sampling == "covariance":
            units = jnp.sqrt(jnp.diagonal(noise))
            return covariance_scaled(number, units, num_directions=num_directions, stretch=stretch, pattern=pattern)
        return dynamic_noise(number, noise, stretch=stretch, spread=sampling == "hypotheses")

    tracker = _Tracker(
        boxed, _joined(limits, boxed), proposal, jumps, num_particles, num_modes, num_starts, num_steps, prior == "closest"
    )

    return filter_of_steps(tracker.initial_state, tracker.step, differentiable=False)


class _Tracker(NamedTuple):
    """The filter: its model in bounded coordinates, the constraints (None where there are none), and its settings."""

    boxed: Bounded
    limits: Constraints | None
    proposal: Callable[[int, Array], ModeProposal]
    jumps: Jumps | None
    num_particles: int
    num_modes: int
    num_starts: int
    num_steps: int
    closest: bool

    def initial_state(self, observation: Observation, inputs: Any = None) -> ModeState:
        """The state before the first frame."""
        mean, covariance = self.boxed.model.initial_moments(inputs)
        draws = jnp.broadcast_to(mean, (self.num_particles, *mean.shape))
        return self._state(draws, _one_of(self.num_modes, mean, covariance), inputs, started=False)

    def step(
        self, rng_key: Array, state: ModeState, observation: Observation, inputs: Any = None
    ) -> tuple[ModeState, FilterInfo]:
        """One frame."""
        key_starts, key_draws = jax.random.split(rng_key)
        predicted, noise = predicted_modes(self.boxed.model, state.modes, ~state.started, inputs)
        jump = None if self.jumps is None else partial(self.jumps, inputs=inputs)
        starts = mode_starts(key_starts, predicted, self.num_starts, lambda number: self.proposal(number, noise), jump)
        found = self._search(starts, predicted, jnp.sqrt(jnp.diagonal(noise)), observation, inputs)
        failed = ~jnp.isfinite(found.log_mass)
        posterior = GaussianMixture(jax.nn.log_softmax(found.modes.log_masses), *found.modes.moments())
        modes: GaussianMixture = jax.tree.map(lambda old, new: jnp.where(failed, old, new), predicted, posterior)
        draws = draw_modes(key_draws, modes, self.num_particles, self.limits, found.modes, failed)
        info = filter_info(
            jnp.where(failed, -jnp.inf, found.log_mass),
            self.num_particles,
            self.num_particles,
            failed,
            num_likelihood=found.evaluations,
            num_gradient=found.evaluations,
        )
        return self._state(draws, modes, inputs, started=True), info

    def _search(
        self, starts: Array, prior: GaussianMixture, units: Array, observation: Observation, inputs: Any
    ) -> ModeSearchResult:
        """The modes of a frame."""
        model, limits = self.boxed.model, constraints(starts.shape[1]) if self.limits is None else self.limits
        log_prior, prior_curvature = prior_density(prior, closest=self.closest)
        return search_modes(
            starts,
            lambda x: model.log_observation(x, observation, inputs) + log_prior(x),
            lambda x: prior_curvature(x) + model.observation_information(x, observation, inputs),
            limits,
            self.num_modes,
            units=units,
            num_steps=self.num_steps,
        )

    def _state(self, draws: Array, modes: GaussianMixture, inputs: Any, *, started: bool) -> ModeState:
        particles = jax.vmap(lambda y: self.boxed.to_unbounded(y, inputs))(draws)
        log_weights = jnp.full(len(draws), -np.log(len(draws)), draws.dtype)
        return ModeState(particles, log_weights, modes, jnp.asarray(started))


def _one_of(number: int, mean: Array, covariance: Array) -> GaussianMixture:
    """A mixture of K, of which the first has all the weight."""
    log_weights = jnp.where(jnp.arange(number) == 0, 0.0, -jnp.inf).astype(mean.dtype)
    return GaussianMixture(log_weights, *(jnp.broadcast_to(part, (number, *part.shape)) for part in (mean, covariance)))


def _joined(limits: Constraints | None, boxed: Bounded) -> Constraints | None:
    """The bounds of the supports, and further constraints; None where there are none of either."""
    own = constraints(len(boxed.lower), lower=boxed.lower, upper=boxed.upper)
    if limits is None:
        return own if np.isfinite([boxed.lower, boxed.upper]).any() else None
    return limits._replace(lower=jnp.maximum(own.lower, limits.lower), upper=jnp.minimum(own.upper, limits.upper))
