r"""Whole-trajectory smoothing: NUTS or hybrid Monte Carlo on the joint density of all frames.

The target is p(x_0, ..., x_(T-1) | z), with the density of :meth:`poseppl.program.CompiledModel.log_joint`, all frames at once
and vmapped over time. Each chain

1. starts from a trajectory drawn from the filter's history (:mod:`poseppl.smoothers.backward_pass`), so that the modes that
the filter
   has are represented among the chains;
2. climbs towards the nearest mode m by damped Gauss-Newton steps over the whole trajectory, which are passes of an iterated
   Kalman smoother (:mod:`poseppl.smoothers.curvature`);
3. samples in coordinates z, x = m + L^(-T) z, in which the posterior is roughly a standard normal in T d dimensions. P = L L^T
   is a block-tridiagonal curvature (:mod:`poseppl.gaussians.block_tridiagonal`), so that a leapfrog step costs one gradient and
   two recurrences over the frames.

P is the mean of the curvature over many trajectories of the history, the same for all chains. Laplace's curvature, at the mode,
serves only where the posterior is nearly Gaussian: for a body seen by one camera the posterior is up to thirty times wider than
it says, and an effective draw cost seven times as many gradients.

For a linear Gaussian model the posterior is exactly the standard normal in z. Step sizes are those of
:mod:`poseppl.kernels.adapted_chain`.

Chains do not cross between modes that are far apart: each mode's share of the draws is then its share of the chains' starts,
that is the filter's, not the posterior's. R-hat over the chains shows this. Sites must be continuous.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.gaussians.block_tridiagonal import solve_upper
from poseppl.kernels.adapted_chain import AdaptedChain, ChainSettings, Kernel, adapted_chain, trajectory_lengths
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.backward_pass import initial_trajectories
from poseppl.smoothers.base import History, Smoothed, Smoother, check_continuous, smoothed_chains
from poseppl.smoothers.curvature import average_precision, find_mode, safe_cholesky


@memoized_builder
def trajectory_smoother(
    model: CompiledModel,
    *,
    num_chains: int = 4,
    num_draws: int = 250,
    num_warmup: int = 100,
    kernel: Kernel = "nuts",
    num_leapfrog: int = 16,
    max_doublings: int = 8,
    target_acceptance: float = 0.8,
    num_mode_steps: int = 5,
    num_curvatures: int = 32,
) -> Smoother:
    """NUTS, or HMC, on the joint density of all frames, whitened by the model's curvature.

    Args:
        model: The compiled model; all its sites are continuous.
        num_chains: M, chains side by side.
        num_draws: R, draws of each chain that count.
        num_warmup: Updates of each chain before them.
        kernel: "nuts" or "hmc".
        num_leapfrog: Leapfrog steps of an update of "hmc" at most.
        max_doublings: "nuts" makes less than 2 to this power leapfrog steps an update.
        target_acceptance: Acceptance rate that the step size is adapted to.
        num_mode_steps: Gauss-Newton steps from a start towards its mode.
        num_curvatures: Trajectories of the history over which the curvature is averaged.

    Returns:
        The smoother; its particles are (T, M, R, d), and the draw of one index is a whole trajectory.

    Raises:
        ValueError: A number or rate out of range, an unknown kernel, or a model with discrete sites.
    """
    check_at_least(1, num_chains=num_chains, num_curvatures=num_curvatures)
    check_at_least(0, num_mode_steps=num_mode_steps)
    check_continuous(model)
    settings = ChainSettings(num_draws, num_warmup, kernel, num_leapfrog, max_doublings, target_acceptance).check()

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_start, key_length, key_chains = jax.random.split(rng_key, 3)
        drawn = initial_trajectories(model, key_start, history, inputs, max(num_chains, num_curvatures))
        factor = safe_cholesky(average_precision(model, drawn[:num_curvatures], observations, inputs))
        lengths = trajectory_lengths(key_length, settings)

        def run(key: Array, start: Array) -> tuple[Array, AdaptedChain]:
            mode = find_mode(model, start, observations, inputs, num_mode_steps)

            def to_states(z: Array) -> Array:
                return mode + solve_upper(factor, z.reshape(mode.shape))

            def log_density(z: Array) -> Array:
                return model.log_joint(to_states(z), observations, inputs)

            chain = adapted_chain(key, jnp.zeros(mode.size, mode.dtype), log_density, settings, lengths)
            return jax.vmap(to_states)(chain.draws), chain

        draws, chains = jax.vmap(run)(jax.random.split(key_chains, num_chains), drawn[:num_chains])
        num_frames = drawn.shape[1]
        return smoothed_chains(
            jnp.moveaxis(draws, 2, 0),
            acceptance=jnp.mean(chains.acceptance),
            divergences=jnp.sum(chains.divergences),
            num_gradient=num_frames * (jnp.sum(chains.num_gradient) + num_chains * num_mode_steps),
        )

    return Smoother(smooth, joint=True)
