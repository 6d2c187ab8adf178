r"""Gibbs smoothing on the mixture approximation of the likelihood.

Section 4.5 of Peursum, Venkatesh and West 2010 (doi:10.1007/s11263-009-0205-5): with a component s_t for each frame, the states
of all frames are drawn in turn from their distributions given the rest,

    p(x, s | z) ~ p(x_0) prod_t p(x_t | x_(t-1)) prod_t phi_(t, s_t)(x_t),

for 2,000 rounds, of which the first 5 % are left out; so do the defaults, in four chains. The paper's states are discrete;
these stay continuous, and the frame moves are those of :mod:`poseppl.smoothers.published.gibbs_moves`. Given their neighbours,
even frames are independent of each other, and odd ones too: a round moves all even frames at once, then all odd ones,
in several chains side by side. If transitions are linear Gaussian, x may also be drawn as a whole given s (blocked; Carter
and Kohn 1994, doi:10.1093/biomet/81.3.541).

One chain starts at the most likely particle of every frame (section 5.2), the others at trajectories drawn from the filter. A
chain moves frame by frame, and does not cross between modes of whole trajectories: these it has from its start.

The target is the model with the mixture for its likelihood; nothing makes up for the error of that (the mixture's own
module says how large it is), except `target="model"`: the same moves are accepted against the likelihood itself, which is then
evaluated at every move, and chains converge to the smoothing distribution.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_choice
from poseppl.filters.base import check_noise
from poseppl.gaussians.block_tridiagonal import block_cholesky, solve, solve_upper
from poseppl.gaussians.linear_transitions import linear_transitions, quadratic_prior, transition_structure
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.backward_pass import initial_trajectories
from poseppl.smoothers.base import NOISELESS, History, Smoothed, Smoother, smoothed_chains
from poseppl.smoothers.published.gibbs_moves import Frames, Settings, move_frame, prepare_frames
from poseppl.smoothers.published.likelihood_mixture import (
    LikelihoodMixture,
    MixtureSettings,
    fit_likelihood_mixture,
    log_components,
)

Target = Literal["mixture", "model"]


class GibbsChains(NamedTuple):
    """Result of M chains of R rounds: ``draws`` (M, R, T, d), and the mean ``acceptance`` at each frame (T,)."""

    draws: Array
    acceptance: Array


@memoized_builder
def gibbs_smoother(
    model: CompiledModel,
    *,
    num_components: int = 50,
    num_chains: int = 4,
    num_draws: int = 475,
    num_warmup: int = 25,
    target: Target = "mixture",
    collapsed: bool = True,
    blocked: bool = False,
    mixture: MixtureSettings | None = None,
) -> Smoother:
    """Gibbs sampling, the likelihood replaced by a mixture learned from the filter.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        num_components: K, the most components of a frame's likelihood; goes before the setting in `mixture`.
        num_chains: M, Markov chains side by side.
        num_draws: R, draws of each chain that count, one a round.
        num_warmup: Rounds of each chain before them.
        target: "mixture", or "model" for moves that are accepted against the likelihood itself.
        collapsed: Whether components are drawn with the state integrated out; False draws them given it, as the paper does.
        blocked: Whether a round draws the whole trajectory given the components; for linear Gaussian transitions alone.
        mixture: The other settings of the mixture;
            :class:`~poseppl.smoothers.published.likelihood_mixture.MixtureSettings` if None.

    Returns:
        The smoother.

    Raises:
        UnsuitableModelError: A site has no noise.
        ValueError: A setting out of range; when it is run, `blocked` with a transition that is not linear.
    """
    check_noise(model, NOISELESS)
    check_at_least(1, num_chains=num_chains, num_draws=num_draws)
    check_at_least(0, num_warmup=num_warmup)
    check_choice(Target, target=target)
    if blocked and target == "model":
        raise RangeError("blocked", blocked, "False with target='model': blocked rounds draw from the mixture")
    settings = (mixture or MixtureSettings())._replace(num_components=num_components).check()
    num_rounds = num_warmup + num_draws

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_fit, key_start, key_chains = jax.random.split(rng_key, 3)
        likelihood = fit_likelihood_mixture(key_fit, model, history, observations, inputs, settings)
        starts = gibbs_starts(model, key_start, history, inputs, num_chains)
        chains = gibbs_chains(
            key_chains,
            model,
            likelihood,
            starts,
            observations,
            inputs,
            num_rounds,
            num_warmup,
            true_likelihood=target == "model",
            collapsed=collapsed,
            blocked=blocked,
        )
        draws = jnp.moveaxis(chains.draws, 2, 0)
        return smoothed_chains(
            draws,
            acceptance=chains.acceptance,
            num_transition=float(0 if blocked else 4 * num_chains * num_rounds * len(draws)),
        )

    return Smoother(smooth, joint=True)


def gibbs_starts(model: CompiledModel, rng_key: Array, history: History, inputs: Any, num_chains: int) -> Array:
    """Trajectories (M, T, d): the most likely particle of every frame, then trajectories drawn by backward simulation."""
    place = jnp.arange(history.log_weights.shape[0])
    best = history.particles[place, jnp.argmax(history.log_weights, axis=1)]
    if num_chains == 1:
        return best[None]
    return jnp.concatenate([best[None], initial_trajectories(model, rng_key, history, inputs, num_chains - 1)])


def gibbs_chains(
    rng_key: Array,
    model: CompiledModel,
    mixture: LikelihoodMixture,
    starts: Array,
    observations: Observation,
    inputs: Any,
    num_rounds: int,
    num_warmup: int = 0,
    *,
    true_likelihood: bool = False,
    collapsed: bool = True,
    blocked: bool = False,
) -> GibbsChains:
    """Run M chains on a mixture.

    Args:
        rng_key: PRNG key.
        model: The compiled model, its initial and transition programs with Gaussian moments.
        mixture: Mixture of the likelihood of every frame.
        starts: Trajectories (M, T, d).
        observations: Stacked data with leading T; only `true_likelihood` reads them.
        inputs: Stacked inputs with leading T, or None.
        num_rounds: Rounds of each chain.
        num_warmup: How many of them, the first, are left out.
        true_likelihood: Whether moves are accepted against the likelihood itself.
        collapsed: Whether components are drawn with the state integrated out.
        blocked: Whether a round draws the whole trajectory given the components.

    Raises:
        ValueError: `blocked` with a transition that is not linear.
    """
    structure = transition_structure(model, inputs)
    if blocked and not structure.linear:
        raise ValueError("blocked rounds need a linear Gaussian transition; leave out blocked.")
    settings = Settings(structure.linear, collapsed, true_likelihood)
    frames = prepare_frames(model, mixture, observations, inputs, structure)
    if blocked:
        prior = quadratic_prior(linear_transitions(model, starts[0], inputs), starts[0])

    def advance(xs: Array, rng_key: Array) -> tuple[Array, tuple[Array, Array]]:
        if blocked:
            xs, acceptance = _blocked_round(rng_key, mixture, prior, starts[0], xs), jnp.ones(xs.shape[1], xs.dtype)
        else:
            xs, acceptance = _round(model, settings, frames, rng_key, xs)
        return xs, (xs, acceptance)

    _, (draws, acceptance) = jax.lax.scan(advance, starts, jax.random.split(rng_key, num_rounds))
    return GibbsChains(jnp.swapaxes(draws[num_warmup:], 0, 1), jnp.mean(acceptance[num_warmup:], 0))


def _round(model: CompiledModel, settings: Settings, frames: Frames, rng_key: Array, xs: Array) -> tuple[Array, Array]:
    """Move all even frames of trajectories (M, T, d), then all odd ones; returns them and the mean acceptance (T,)."""
    num_chains, num_frames, _ = xs.shape
    kinds, size = min(2, num_frames), -(-num_frames // 2)
    # of an odd number of frames the last place of the odd ones lies beyond the end: it reads the last frame, writes nowhere
    places = jnp.arange(kinds)[:, None] + 2 * jnp.arange(size)

    def move(state: tuple[Array, Array], row: tuple[Array, Array]) -> tuple[tuple[Array, Array], None]:
        xs, acceptance = state
        rng_key, place = row
        end = num_frames - 1
        here = jnp.minimum(place, end)
        rows = tree_index(frames, here)

        def move_chain(keys: Array, x: Array) -> tuple[Array, Array]:
            befores, afters = x[jnp.maximum(here - 1, 0)], x[jnp.minimum(here + 1, end)]
            return jax.vmap(lambda *row: move_frame(model, settings, *row))(keys, x[here], befores, afters, rows)

        moved, accepted = jax.vmap(move_chain)(jax.random.split(rng_key, (num_chains, size)), xs)
        xs = xs.at[:, place].set(moved, mode="drop")
        return (xs, acceptance.at[place].set(jnp.mean(accepted, 0), mode="drop")), None

    start = xs, jnp.zeros(num_frames, xs.dtype)
    (xs, acceptance), _ = jax.lax.scan(move, start, (jax.random.split(rng_key, kinds), places))
    return xs, acceptance


def _blocked_round(rng_key: Array, mixture: LikelihoodMixture, prior: Any, origin: Array, xs: Array) -> Array:
    """Draw components given the trajectories (M, T, d), then the trajectories given them."""
    precision, gradient = prior
    place = jnp.arange(xs.shape[1])

    def draw(key_components: Array, noise: Array, x: Array) -> Array:
        chosen = jax.random.categorical(key_components, jax.vmap(log_components)(mixture, x))
        curvatures = mixture.precisions[place, jnp.minimum(chosen, mixture.precisions.shape[1] - 1)]
        pull = mixture.gradients[place, chosen] - jnp.einsum("tij,tj->ti", curvatures, origin - mixture.anchors[place, chosen])
        factor = block_cholesky(precision._replace(diagonal=precision.diagonal + curvatures))
        return origin + solve(factor, gradient + pull) + solve_upper(factor, noise)

    key_components, key_noise = jax.random.split(rng_key)
    noise = jax.random.normal(key_noise, xs.shape, xs.dtype)
    return jax.vmap(draw)(jax.random.split(key_components, xs.shape[0]), noise, xs)
