r"""Particle Gibbs for static parameters: trajectories and params drawn in turn from each other's conditional.

Andrieu, Doucet and Holenstein 2010, section 4.5 (doi:10.1111/j.1467-9868.2009.00736.x). Each sweep of each chain

1. moves the trajectory, x | params, z, by conditional sequential Monte Carlo (:mod:`poseppl.smoothers.conditional_smc`);
2. moves the params, u | x, z in unconstrained coordinates, by NUTS or another kernel (:mod:`poseppl.kernels.gibbs`) on

       log p(x, z | params(u)) + log p(params(u)) + log |det d params / d u|,

whose mass matrix is learned from all chains in the warm-up (:mod:`poseppl.kernels.adaptive_covariance`), and whose step size is
adapted by dual averaging; both are then frozen. The draws of (x, params) have their joint posterior as law, for any number of
particles.

The chain mixes slowly where a param is nearly determined by the trajectory, as the scale of a random walk over many frames is:
its conditional is then much narrower than its posterior. PMMH (:mod:`poseppl.smoothers.particle_marginal`) conditions on no
trajectory.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
from blackjax.adaptation.step_size import dual_averaging_adaptation
from jax import Array

from poseppl.checks import check_at_least, check_choice, check_key
from poseppl.filters.particle import particle_filter
from poseppl.kernels.adapted_chain import unchecked
from poseppl.kernels.adaptive_covariance import AdaptiveCovariance, learn, ridged
from poseppl.kernels.gibbs import gibbs_kernel
from poseppl.kernels.own_kernel import CustomKernel, Updated
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.earlier_inputs import with_earlier_data
from poseppl.program.frame_inputs import stacked_inputs
from poseppl.program.observation import num_frames_of
from poseppl.program.parameters import ParameterBijector, parameter_bijector
from poseppl.smoothers.backward_pass import initial_trajectories
from poseppl.smoothers.base import Smoothed, smoothed_chains
from poseppl.smoothers.conditional_smc import Method, conditional_smc
from poseppl.smoothers.inner_filter import filter_history
from poseppl.smoothers.particle_marginal import starting_points

_TARGET_ACCEPTANCE = 0.8
_MAX_DOUBLINGS = 6


class ParticleGibbs(NamedTuple):
    """Result of particle Gibbs; the draws of one index belong together.

    Attributes:
        params: Draws by name (M, R, ...), constrained.
        unconstrained: The same draws (M, R, p).
        smoothed: The trajectories, particles (T, M, R, d).
        acceptance: Mean acceptance rate of the params' moves, after the warm-up.
        step_size: Their frozen step size.
    """

    params: dict[str, Array]
    unconstrained: Array
    smoothed: Smoothed
    acceptance: Array
    step_size: Array


class _Setting(NamedTuple):
    """Constants of all sweeps."""

    model: CompiledModel
    bijector: ParameterBijector
    observations: Observation
    inputs: Any
    num_particles: int
    method: Method
    num_warmup: int
    kernel: CustomKernel | None

    def bound(self, u: Array) -> CompiledModel:
        """The model with the params of u (p,)."""
        return self.model.with_params(self.bijector.to_params(u))


class _State(NamedTuple):
    """Trajectories (M, T, d), params (M, p), the step size's adaptation, and what is known of the params."""

    trajectories: Array
    positions: Array
    adaptation: Any
    known: AdaptiveCovariance


def particle_gibbs(
    model: CompiledModel,
    rng_key: Array,
    observations: Observation,
    inputs: Any = None,
    *,
    num_particles: int = 100,
    num_chains: int = 4,
    num_draws: int = 500,
    num_warmup: int = 250,
    method: Method = "ancestor",
    start: Mapping[str, Any] | None = None,
    kernel: CustomKernel | None = None,
) -> ParticleGibbs:
    """Sample the posterior of a model's trajectory and static parameters.

    Args:
        model: The compiled model, with a parameters program.
        rng_key: PRNG key.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`; None where the model
            takes none.
        num_particles: N of each move of a trajectory.
        num_chains: M, chains side by side.
        num_draws: R, draws of each chain that count.
        num_warmup: Sweeps of each chain before them.
        method: How a trajectory is drawn, "ancestor" sampling or "backward" simulation.
        start: Params by name that all chains start from; draws from the prior if None.
        kernel: A kernel that moves the params in unconstrained coordinates, in place of NUTS; the step size is adapted to its
            acceptance rate.

    Returns:
        The draws. The function can be jitted.

    Raises:
        ValueError: A number out of range, an unknown method, data that are not an Observation, or data or inputs that do not
            have T frames. Also a parameters program that cannot be learned, or a start that is not a value of its params.
    """
    check_at_least(2, num_particles=num_particles)
    check_at_least(1, num_chains=num_chains, num_draws=num_draws)
    check_at_least(0, num_warmup=num_warmup)
    check_choice(Method, method=method)
    check_key(rng_key)
    num_frames = num_frames_of(model.observation_sites, observations)
    inputs = stacked_inputs(with_earlier_data(model, observations, inputs), num_frames)
    bijector = parameter_bijector(model)
    setting = _Setting(model, bijector, observations, inputs, num_particles, method, num_warmup, kernel)
    key_params, key_states, key_sweeps = jax.random.split(rng_key, 3)
    positions, known = starting_points(model, bijector, key_params, num_chains, start)
    trajectories = jax.vmap(partial(_first_trajectory, setting))(jax.random.split(key_states, num_chains), positions)
    adaptation: Any = dual_averaging_adaptation(_TARGET_ACCEPTANCE)[0](jnp.asarray(0.5, positions.dtype))
    adaptation = jax.tree.map(lambda leaf: jnp.asarray(leaf, positions.dtype), adaptation)
    adaptation = adaptation._replace(log_step_size_avg=adaptation.log_step_size)
    rows = jax.random.split(key_sweeps, num_warmup + num_draws), jnp.arange(num_warmup + num_draws)
    final, kept = jax.lax.scan(partial(_sweep, setting), _State(trajectories, positions, adaptation, known), rows)
    draws, params, diagnosis = tree_index(kept, slice(num_warmup, None))
    unconstrained = jnp.swapaxes(params, 0, 1)
    return ParticleGibbs(
        params=jax.vmap(jax.vmap(bijector.to_params))(unconstrained),
        unconstrained=unconstrained,
        smoothed=_smoothed(jnp.transpose(draws, (2, 1, 0, 3)), diagnosis, len(rows[1]) * num_chains * num_particles),
        acceptance=jnp.mean(diagnosis[0]),
        step_size=jnp.exp(final.adaptation.log_step_size_avg),
    )


def _sweep(setting: _Setting, state: _State, row: tuple[Array, Array]) -> tuple[_State, Any]:
    """Move the trajectory and then the params of every chain."""
    key, number = row
    early = number < setting.num_warmup
    log_step_size = jnp.where(early, state.adaptation.log_step_size, state.adaptation.log_step_size_avg)
    step_size, mass = jnp.exp(log_step_size), ridged(state.known.covariance)

    def move_trajectory(key: Array, position: Any) -> Array:
        model, xs = setting.bound(position["params"]), position["trajectory"]
        return conditional_smc(model, key, xs, setting.observations, setting.inputs, setting.num_particles, setting.method)

    sweep = gibbs_kernel({"trajectory": move_trajectory, "params": setting.kernel or _nuts(mass)})

    def move(key: Array, xs: Array, u: Array) -> tuple[Any, Updated]:
        joint = partial(_log_joint, setting)
        moved, moves = sweep.step(key, sweep.init({"trajectory": xs, "params": u}, joint), joint, step_size)
        return moved.position, moves["params"]

    keys = jax.random.split(key, state.positions.shape[0])
    moved, update = jax.vmap(move)(keys, state.trajectories, state.positions)
    xs, positions = moved["trajectory"], moved["params"]
    acceptance = jnp.mean(jnp.where(jnp.isnan(update.acceptance), 0.0, update.acceptance))
    _, improve, _ = dual_averaging_adaptation(_TARGET_ACCEPTANCE)
    learned = improve(state.adaptation, acceptance), learn(state.known, positions, number)
    frozen = state.adaptation, state.known
    adapted = jax.tree.map(lambda new, old: jnp.where(early, new, old).astype(old.dtype), learned, frozen)
    changed = jnp.mean(jnp.any(xs != state.trajectories, -1), 0)
    diagnosis = (acceptance, changed, jnp.sum(update.divergent), jnp.sum(update.evaluations + 1))
    return _State(xs, positions, *adapted), (xs, positions, diagnosis)


def _log_joint(setting: _Setting, position: Any) -> Array:
    """Log-density of a trajectory, params and the data; NaN counts as -inf."""
    u = position["params"]
    joint = setting.bound(u).log_joint(position["trajectory"], setting.observations, setting.inputs)
    value = joint + setting.bijector.log_prior(setting.model, u)
    return nan_to_neg_inf(value)


def _nuts(mass: Array) -> CustomKernel:
    kernel: Any = blackjax.nuts.build_kernel()

    def step(rng_key: Array, state: Any, log_density: Any, step_size: Array) -> Any:
        return kernel(unchecked(rng_key), state, log_density, step_size, mass, _MAX_DOUBLINGS)

    return CustomKernel(blackjax.hmc.init, step)


def _first_trajectory(setting: _Setting, rng_key: Array, u: Array) -> Array:
    key_filter, key_draw = jax.random.split(rng_key)
    model = setting.bound(u)
    history = filter_history(particle_filter(model, setting.num_particles), key_filter, setting.observations, setting.inputs)
    return initial_trajectories(model, key_draw, history, setting.inputs, 1)[0]


def _smoothed(particles: Array, diagnosis: Any, num_moved: int) -> Smoothed:
    _, changed, divergent, gradients = diagnosis
    num_frames = particles.shape[0]
    return smoothed_chains(
        particles,
        acceptance=jnp.mean(changed, 0),
        divergences=jnp.sum(divergent),
        num_transition=float(num_moved * (num_frames - 1)),
        num_gradient=num_frames * jnp.sum(gradients),
    )
