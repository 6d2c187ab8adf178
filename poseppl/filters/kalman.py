"""The Kalman filter, and for programs that are not linear the extended and the unscented one.

The posterior of each frame is kept as a Gaussian; transition and observation are linearised around it, by a first-order
expansion (the extended Kalman filter), over sigma points (the unscented one) or a Gauss-Hermite grid; see
:mod:`poseppl.gaussians.linearisation`. With more than one iteration the observation is linearised again, around the posterior
of the last linearisation, and the update is repeated: posterior linearisation (Garcia-Fernandez, Svensson, Morelande and Sarkka
2015, doi:10.1109/TSP.2015.2454485), for first-order lines the iterated extended Kalman filter. Exact for linear Gaussian
programs. In others it knows one mode, and where the data are ambiguous its intervals are wrong: it is a baseline and an oracle.

The particles of its state are independent draws from the Gaussian, for whatever reads particles. They are made when they are
read: a run that keeps moments alone draws nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.errors import UnsuitableModelError
from poseppl.filters.base import Filter, FilterInfo, filter_info, filter_of_steps
from poseppl.filters.in_parallel import Schedule, is_linear, linear_sequence, wants_parallel
from poseppl.gaussians.diffuse import DiffuseGaussian, diffuse_gaussian
from poseppl.gaussians.gaussian import Gaussian, RootGaussian, lower_root, semidefinite_root
from poseppl.gaussians.linearisation import Linear, Method, Moments, condition, linearise, linearise_about, predict
from poseppl.gaussians.marginals import Marginals, gaussian_marginals
from poseppl.gaussians.parallel import LinearFrames
from poseppl.particles.stacks import prepend, tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder

_NOISE = "threefry2x32"
"""The generator of a state's draws, whatever that of the run's key."""
_FEW = 32
"""Coordinates and data of a frame up to which LAPACK factors them with one thread."""


class KalmanState(NamedTuple):
    """The Gaussian, and what its draws are made of.

    Attributes:
        log_weights: Log-weights (N,), all -log N.
        joint: Mean (d,) and covariance (d, d), of few coordinates by its root, or with directions that are not yet known.
        started: Whether there has been a frame, a boolean; before the first one `joint` is that of the initial program.
        noise: Data of the key that the draws are made from, uint32 (2,).
    """

    log_weights: Array
    joint: Gaussian | RootGaussian | DiffuseGaussian
    started: Array
    noise: Array

    @property
    def posterior(self) -> Gaussian | RootGaussian:
        """The Gaussian; a direction that nothing is known of has a standard deviation of 10^15."""
        return self.joint.proper if isinstance(self.joint, DiffuseGaussian) else self.joint

    @property
    def particles(self) -> Array:
        """Draws (N, d), the same at each reading; of stacked states (..., N, d)."""
        if self.noise.ndim > 1:
            stacked: Array = jax.vmap(lambda state: state.particles)(self)
            return stacked
        mean = jnp.asarray(self.posterior.mean)
        key = jax.random.wrap_key_data(self.noise, impl=_NOISE)
        return mean + jax.random.normal(key, (*self.log_weights.shape, *mean.shape), mean.dtype) @ lower_root(self.posterior).T

    @property
    def marginals(self) -> Marginals:
        """Those of the Gaussian."""
        return gaussian_marginals(self.posterior.mean, self.posterior.covariance)


def with_root(mean: Array, covariance: Array) -> RootGaussian:
    """A Gaussian of mean (d,) and covariance (d, d), with the root of its covariance."""
    return RootGaussian(mean, semidefinite_root(covariance))


def is_diffuse(model: CompiledModel) -> bool:
    """Whether a start is diffuse, or data have no noise."""
    return bool(model.diffuse) or any(site.noiseless for site in model.observation_sites.values())


def gaussian_form(model: CompiledModel) -> Callable[[Array, Array], Any]:
    """How the Gaussians of a model are kept: few coordinates by the root of the covariance, which float32 rounds less.

    Those of a diffuse start or of data without noise are kept by :mod:`poseppl.gaussians.diffuse`.
    """
    if is_diffuse(model):
        return lambda mean, covariance: diffuse_gaussian(mean, covariance, model.diffuse_coordinates)
    num_data = sum(math.prod(site.shape) for site in model.observation_sites.values())
    return with_root if model.dimension + num_data <= _FEW else Gaussian


@memoized_builder
def kalman_filter(
    model: CompiledModel,
    num_particles: int = 1000,
    *,
    linearisation: Method = "first-order",
    num_iterations: int = 1,
    schedule: Schedule = "auto",
) -> Filter:
    """The Kalman filter, extended or unscented where programs are not linear: one Gaussian.

    Args:
        model: The compiled model, all its programs with Gaussian moments.
        num_particles: N, draws from each frame's Gaussian.
        linearisation: "first-order" (extended Kalman filter), "unscented", or up to 6 coordinates "gauss-hermite".
        num_iterations: Linearisations of each frame's observation, the first around the prediction.
        schedule: How `scan_filter` and `log_likelihood` run frames of linear programs: "parallel" in time (see
            :mod:`poseppl.gaussians.parallel`), one after the other, or "auto", parallel on a GPU or TPU. `infer`, whose runs go
            on from any frame, runs them one after the other.

    Returns:
        The filter; its state is :class:`KalmanState`.

    Raises:
        ValueError: A number below 1 or an unknown linearisation; a program without Gaussian moments when the filter is traced.
    """
    check_at_least(1, num_particles=num_particles, num_iterations=num_iterations)
    check_choice(Method, linearisation=linearisation)
    check_choice(Schedule, schedule=schedule)
    form = gaussian_form(model)
    diffuse = is_diffuse(model)

    def initial_state(observation: Observation, inputs: Any = None) -> KalmanState:
        initial = form(*model.initial_moments(inputs, diffuse=True))
        weights = jnp.zeros(num_particles, initial.mean.dtype)
        return KalmanState(weights, initial, jnp.zeros((), bool), jnp.zeros(2, jnp.uint32))

    def step(
        rng_key: Array, state: KalmanState, observation: Observation, inputs: Any = None
    ) -> tuple[KalmanState, FilterInfo]:
        before: Any = state.joint
        linear = linearise(lambda x: model.transition_moments(x, inputs), before, linearisation)
        # both are finite at every frame, and with them the gradient of the one that is not chosen
        initial, moved = form(*model.initial_moments(inputs, diffuse=True)), predict(before, linear)
        predicted: Any = jax.tree.map(lambda a, b: jnp.where(state.started, a, b), moved, initial)
        posterior, log_evidence, failed = update(model, predicted, observation, inputs, linearisation, num_iterations)
        return _concluded(rng_key, posterior, log_evidence, failed, num_particles)

    def in_parallel(keys: Array, observations: Observation, stacked: Callable[[], Any]) -> Any:
        if not wants_parallel(schedule, not diffuse) or len(keys) == 1:
            return None
        inputs = stacked()
        if diffuse or not is_linear(model, inputs):
            if schedule == "auto":
                return None
            raise UnsuitableModelError(
                "Frames in parallel need linear Gaussian programs, a proper start and noise. Use schedule='sequential'."
            )
        return _in_parallel(model, form, num_particles, keys, observations, inputs)

    return filter_of_steps(initial_state, step, closed_form=True, in_parallel=in_parallel)


def _in_parallel(
    model: CompiledModel, form: Any, num_particles: int, keys: Array, observations: Observation, inputs: Any
) -> tuple[KalmanState, FilterInfo]:
    """States and diagnoses of T frames: predictions from the filtered Gaussians of a parallel pass, and their updates."""
    sequence = linear_sequence(model, observations, inputs, "first-order")
    filtered = tree_index(sequence.filtered, slice(-1))

    def ahead(mean: Array, covariance: Array, line: LinearFrames) -> Any:
        return predict(form(mean, covariance), Linear(line.jacobian @ mean + line.offset, line.jacobian, line.noise))

    later = jax.vmap(ahead)(*filtered, tree_index(sequence.transitions, slice(1, None)))
    first = form(*model.initial_moments(tree_index(inputs, 0)))
    predicted = prepend(first, later)

    def taken_in(key: Array, predicted: Any, observation: Observation, inputs: Any) -> tuple[KalmanState, FilterInfo]:
        posterior, log_evidence, failed = update(model, predicted, observation, inputs, "first-order")
        return _concluded(key, posterior, log_evidence, failed, num_particles)

    return jax.vmap(taken_in)(keys, predicted, observations, inputs)


def _concluded(
    rng_key: Array, posterior: Any, log_evidence: Array, failed: Array, num_particles: int
) -> tuple[KalmanState, FilterInfo]:
    """State and diagnosis of a frame."""
    info = filter_info(log_evidence, num_particles, num_particles, failed, num_likelihood=1, num_gradient=1)
    log_weights = jnp.full(num_particles, -jnp.log(num_particles), posterior.mean.dtype)
    noise = jax.random.key_data(rng_key)[:2]
    return KalmanState(log_weights, posterior, jnp.ones((), bool), noise), info


def update(
    model: CompiledModel,
    predicted: Moments,
    observation: Observation,
    inputs: Any,
    method: Method,
    num_iterations: int = 1,
    about: Gaussian | RootGaussian | DiffuseGaussian | None = None,
) -> tuple[Moments, Array, Array]:
    """Condition a prediction on a frame's data.

    Args:
        model: The compiled model.
        predicted: The prediction.
        observation: The frame's data.
        inputs: Its inputs.
        method: How the observation is linearised.
        num_iterations: How often, each time but the first around the last posterior.
        about: The first point of linearisation; the prediction if None.

    Returns:
        The posterior, the log-evidence (-inf if it failed), and whether the data were impossible: the posterior is then the
        prediction.
    """
    data, seen = model.flat_observation(observation)

    def conditioned(about: Gaussian | RootGaussian | DiffuseGaussian) -> tuple[Moments, Array]:
        linear = linearise_about(
            lambda x: model.observation_moments(x, inputs),
            predicted,
            about,
            method,
            lambda x: model.observation_jacobian(x, inputs),
        )
        return condition(predicted, linear, data, seen)

    posterior, log_evidence = conditioned(predicted if about is None else about)
    if num_iterations > 1:

        def again(_: int, found: tuple[Moments, Array]) -> tuple[Moments, Array]:
            new = conditioned(found[0])
            usable = jnp.all(jnp.isfinite(new[0].mean)) & jnp.isfinite(new[1])
            kept: tuple[Moments, Array] = jax.tree.map(lambda a, b: jnp.where(usable, a, b), new, found)
            return kept

        posterior, log_evidence = jax.lax.fori_loop(1, num_iterations, again, (posterior, log_evidence))
    failed = ~(jnp.isfinite(log_evidence) & jnp.all(jnp.isfinite(posterior.mean)))
    kept = jax.tree.map(lambda new, old: jnp.where(failed, old, new), posterior, predicted)
    return kept, jnp.where(failed, -jnp.inf, log_evidence), failed
