r"""Variational smoothing on the mixture approximation of the likelihood.

Section 4.4 of Peursum, Venkatesh and West 2010 (doi:10.1007/s11263-009-0205-5), which leaves the equations to a report. Here
they are, for states that stay continuous. With a component s_t for each frame the model on the mixture is

    p(x, s, z) = p(x_0) prod_t p(x_t | x_(t-1)) prod_t phi_(t, s_t)(x_t),

phi of :mod:`poseppl.smoothers.published.likelihood_mixture`. We look for q(x) q(s), q(s) = prod_t r_t(s_t), with the least free
energy, which is KL(q || p(x, s | z)) up to a constant:

    F = E_q[-log p(x)] - H[q(x)] + sum_t sum_k r_tk (log r_tk - l_tk),      l_tk = E_q[log phi_tk(x_t)].

*q(s) given q(x).* F is least at r_tk = exp(l_tk) / sum_j exp(l_tj); with q(x_t) of mean mu_t and covariance S_t

    l_tk = log phi_tk(mu_t) - tr(L_tk S_t) / 2.

*q(x) given q(s).* As a function of q(x), F is KL(q(x) || p(x) prod_t exp sum_k r_tk log phi_tk(x_t)) up to a constant. The
exponent is quadratic: one Gaussian pseudo-observation a frame, of precision L_t = sum_k r_tk L_tk and gradient at mu_t

    c_t = sum_k r_tk (b_tk - L_tk (mu_t - a_tk)).

For linear Gaussian transitions with prior precision J and gradient h around mu (:mod:`poseppl.gaussians.linear_transitions`)
the least F is at the Gaussian of precision J + diag(L_t) and mean mu + (J + diag(L_t))^-1 (h + c): a Rauch-Tung-Striebel
smoother on the pseudo-observations. If q(x) is to be a product over frames, as in the paper, each factor's least F, the others
given, has precision J_tt + L_t and mean mu_t + (J_tt + L_t)^-1 (h_t + c_t); frames that are not neighbours do not enter each
other's, so all even frames are set at once and then all odd ones.

*Transitions that are not linear.* J and h are those of the transition linearised at mu, and the natural parameters of q(x) go
a fraction alpha of the way, 1, 1/2, 1/4, ... or none, whichever has the least F. E_q[-log p(x)] is taken by the spherical
cubature rule of degree 3 (Arasaratnam and Haykin 2009, doi:10.1109/TAC.2009.2019800), which is exact for linear transitions.
So F, as computed, never rises, whatever the transition.

q(x) starts at the filter's means and variances (section 5.2). F has many minima, and a factorised or single Gaussian q(x)
chooses among modes: with narrow components it stays near where it started, with at most the variance of one of them
(`poseppl reproduce peursum-2010 mixtures`). For likelihoods with one mode a single component does better. A free component with
a corrected density is the exact smoother of linear Gaussian models, up to the Monte Carlo error of the moments.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least
from poseppl.filters.base import check_noise
from poseppl.gaussians.block_tridiagonal import (
    BlockCholesky,
    BlockTridiagonal,
    block_cholesky,
    marginal_covariances,
    solve,
    solve_upper,
)
from poseppl.gaussians.linear_transitions import (
    linear_transitions,
    quadratic_prior,
    transition_structure,
)
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import weighted_covariance, weighted_mean
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_initials, log_transitions
from poseppl.smoothers.base import NOISELESS, History, Smoothed, Smoother, smoothed_draws
from poseppl.smoothers.published.likelihood_mixture import (
    LikelihoodMixture,
    MixtureSettings,
    fit_likelihood_mixture,
    log_components,
)

_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.02, 0.0)
"""Fractions of the way to the linearised optimum, tried if the transition is not linear."""


class VariationalFit(NamedTuple):
    """The approximation q(x) q(s).

    Attributes:
        means: Means of q(x_t), (T, d).
        factor: Cholesky factor of the precision of q(x).
        responsibilities: r_tk (T, K).
        free_energy: F at the start and after each round (num_rounds + 1,).
    """

    means: Array
    factor: BlockCholesky
    responsibilities: Array
    free_energy: Array


class _Gaussian(NamedTuple):
    """q(x): means (T, d) and precision."""

    means: Array
    precision: BlockTridiagonal


class _State(NamedTuple):
    """q(x), and the responsibilities (T, K) that are best for it."""

    q: _Gaussian
    shares: Array


@memoized_builder
def mixture_variational_smoother(
    model: CompiledModel,
    *,
    num_components: int = 50,
    num_rounds: int = 30,
    num_draws: int = 1000,
    factorised: bool = False,
    mixture: MixtureSettings | None = None,
) -> Smoother:
    """Variational smoothing, the likelihood replaced by a mixture learned from the filter.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        num_components: K, the most components of a frame's likelihood; goes before the setting in `mixture`.
        num_rounds: Rounds of fixed-point updates.
        num_draws: Draws of q(x) that are returned.
        factorised: Whether q(x) is a product over frames, as in the paper; False keeps the trajectory's dependence.
        mixture: The other settings of the mixture;
            :class:`~poseppl.smoothers.published.likelihood_mixture.MixtureSettings` if None.

    Returns:
        The smoother; ``info.divergences`` counts the rounds in which the free energy rose beyond rounding: 0.

    Raises:
        UnsuitableModelError: A site has no noise.
        ValueError: A number below 1.
    """
    check_noise(model, NOISELESS)
    check_at_least(1, num_rounds=num_rounds, num_draws=num_draws)
    settings = (mixture or MixtureSettings())._replace(num_components=num_components).check()

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_fit, key_draw = jax.random.split(rng_key)
        num_frames, num_particles, dimension = history.particles.shape
        likelihood = fit_likelihood_mixture(key_fit, model, history, observations, inputs, settings)
        fitted = fit_variational(model, history, likelihood, inputs, num_rounds, factorised=factorised)
        noise = jax.random.normal(key_draw, (num_draws, num_frames, dimension), history.particles.dtype)
        draws = fitted.means[:, None] + jnp.swapaxes(jax.vmap(lambda z: solve_upper(fitted.factor, z))(noise), 0, 1)
        energy = fitted.free_energy
        rounding = 100 * float(np.finfo(energy.dtype).eps) * (jnp.max(jnp.abs(energy)) + num_frames * dimension)
        return smoothed_draws(
            draws,
            divergences=jnp.sum(jnp.diff(energy) > rounding),
            num_transition=float(4 * dimension * (num_rounds + 1) * max(num_frames - 1, 0)),
        )

    return Smoother(smooth, joint=not factorised, closed_form=True)


def fit_variational(
    model: CompiledModel,
    history: History,
    mixture: LikelihoodMixture,
    inputs: Any,
    num_rounds: int,
    *,
    factorised: bool = False,
) -> VariationalFit:
    """Find the approximation of least free energy near a filter's.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        history: The filter's, where q(x) starts.
        mixture: Mixture of the likelihood of every frame.
        inputs: Stacked inputs with leading T, or None.
        num_rounds: Rounds of fixed-point updates.
        factorised: Whether q(x) is a product over frames.
    """
    linear = transition_structure(model, inputs).linear
    fractions = jnp.asarray(_FRACTIONS[:1] if linear else _FRACTIONS, history.particles.dtype)
    parity = jnp.arange(history.particles.shape[0]) % 2
    parts = jnp.stack([parity == 0, parity == 1] if factorised else [parity >= 0])

    def move(state: _State, chosen: Array, moves: Array) -> tuple[_State, Array]:
        """Update q(x) at the chosen frames, and q(s); where it does not move, only the free energy is computed."""
        q = state.q
        target, gradient = _target(model, mixture, inputs, state)
        if factorised:
            diagonal = jnp.where(chosen[:, None, None], target.diagonal, q.precision.diagonal)
            target, gradient = BlockTridiagonal(diagonal, q.precision.below), jnp.where(chosen[:, None], gradient, 0.0)

        def towards(fraction: Array) -> tuple[_State, Array]:
            precision = jax.tree.map(lambda old, new: (1 - fraction) * old + fraction * new, q.precision, target)
            factor = block_cholesky(precision)
            means = q.means + solve(factor, fraction * gradient)
            energy, shares = _free_energy(model, mixture, inputs, means, factor)
            return _State(_Gaussian(means, precision), shares), energy

        tried, energies = jax.vmap(towards)(fractions * moves)
        best = jnp.argmin(jnp.where(jnp.isnan(energies), jnp.inf, energies))
        return tree_index((tried, energies), best)

    def update(state: _State, moves: Array) -> tuple[_State, Array]:
        state, energies = jax.lax.scan(lambda state, chosen: move(state, chosen, moves), state, parts)
        return state, energies[-1]

    start = _State(_start(model, history, inputs), jnp.zeros_like(mixture.log_heights))
    # the first round stays where it is: it gives the free energy and the responsibilities at the start
    state, energies = jax.lax.scan(update, start, (jnp.arange(num_rounds + 1) > 0).astype(fractions.dtype))
    return VariationalFit(state.q.means, block_cholesky(state.q.precision), state.shares, energies)


def _start(model: CompiledModel, history: History, inputs: Any) -> _Gaussian:
    """Each frame's mean and variances among the particles, no narrower than 1/1000 of what its neighbours leave."""
    means = jax.vmap(weighted_mean)(history.particles, history.log_weights)
    spread = jax.vmap(lambda x, w: jnp.diagonal(weighted_covariance(x, w)))(history.particles, history.log_weights)
    prior, _ = quadratic_prior(linear_transitions(model, means, inputs), means)
    least = 1e-6 / jnp.diagonal(prior.diagonal, axis1=1, axis2=2)
    diagonal = jax.vmap(jnp.diag)(1.0 / jnp.maximum(spread, least))
    return _Gaussian(means, BlockTridiagonal(diagonal, jnp.zeros_like(prior.below)))


def _expected_log_components(mixture: LikelihoodMixture, means: Array, covariances: Array) -> Array:
    """l_tk (T, K)."""
    spread = jnp.einsum("tcij,tji->tc", mixture.precisions, covariances)
    return jax.vmap(log_components)(mixture, means) - 0.5 * spread


def _target(model: CompiledModel, mixture: LikelihoodMixture, inputs: Any, state: _State) -> tuple[BlockTridiagonal, Array]:
    """Precision of the optimal q(x) given q(s), and the gradient (T, d) at the means."""
    means, shares = state.q.means, state.shares
    offset = means[:, None] - mixture.anchors
    scaled = jnp.einsum("...ij,...j->...i", mixture.precisions, offset)
    pull = jnp.einsum("tk,tki->ti", shares, mixture.gradients - scaled)
    shared = mixture.precisions.shape[1] == 1
    added = mixture.precisions[:, 0] if shared else jnp.einsum("tk,tkij->tij", shares, mixture.precisions)
    prior, gradient = quadratic_prior(linear_transitions(model, means, inputs), means)
    return prior._replace(diagonal=prior.diagonal + added), gradient + pull


def _free_energy(
    model: CompiledModel, mixture: LikelihoodMixture, inputs: Any, means: Array, factor: BlockCholesky
) -> tuple[Array, Array]:
    """F of q(x) with its optimal q(s), and that, the responsibilities (T, K)."""
    covariances = marginal_covariances(factor).own
    logits = _expected_log_components(mixture, means, covariances)
    evidence = jnp.sum(jax.nn.logsumexp(logits, axis=1))
    entropy = 0.5 * means.size * (1.0 + jnp.log(2 * jnp.pi)) - 0.5 * factor.log_det
    energy = _expected_prior(model, inputs, means, factor, covariances) - evidence - entropy
    return energy, jax.nn.softmax(logits, axis=1)


def _expected_prior(model: CompiledModel, inputs: Any, means: Array, factor: BlockCholesky, covariances: Array) -> Array:
    """E_q[-log p(x)] by cubature: over x_0, and over each pair of neighbours, from x_t and x_(t-1) given x_t."""
    num_frames, d = means.shape
    scales = jax.vmap(_square_root)(covariances)
    reach = jnp.sqrt(float(d)) * scales[0].T
    first = means[0] + jnp.concatenate([reach, -reach])
    total = jnp.mean(log_initials(model, first, tree_index(inputs, 0)))
    if num_frames == 1:
        return -total

    def pair(row: Any) -> Array:
        before, mean, scale, gain, inverse, row_inputs = row
        reach = jnp.sqrt(2.0 * d)
        steps = reach * jnp.concatenate([jnp.zeros((d, d), scale.dtype), scale.T])
        earlier = reach * jnp.concatenate([inverse, -scale.T @ gain])
        xs = mean + jnp.concatenate([steps, -steps])
        befores = before + jnp.concatenate([earlier, -earlier])
        return jnp.mean(log_transitions(model, xs, befores, row_inputs))

    later = tree_index(inputs, slice(1, None))
    rows = means[:-1], means[1:], scales[1:], factor.gains, factor.inverses[:-1], later
    return -total - jnp.sum(jax.vmap(pair)(rows))


def _square_root(covariance: Array) -> Array:
    """Lower triangular square root (d, d)."""
    unit = jnp.sqrt(jnp.diagonal(covariance))
    root: Array = jnp.linalg.cholesky(covariance / unit[:, None] / unit) * unit[:, None]
    return root
