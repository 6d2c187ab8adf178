"""The likelihood of every frame as a mixture of Gaussians, learned from a filter's particles.

Section 4.3 of Peursum, Venkatesh and West 2010 (doi:10.1007/s11263-009-0205-5). A likelihood is costly, and known only at the
particles; a smoother that moves them needs it elsewhere. So each frame's is replaced by

    p(z_t | x) ~ sum_k phi_k(x),     phi_k(x) = exp(g_k + b_k.(x - a_k) - (x - a_k)^T L_k (x - a_k) / 2),

that is eta_k N(x; a_k, R_k), written so that a precision L_k may be singular: a frame may say nothing of some directions.
Components come from :mod:`poseppl.gaussians.weighted_em`.

**The paper's mixture.** Its particles are drawn from the prediction pi(x) = p(x_t | z_(<t)) and weighted by the likelihood, and
expectation maximisation estimates the *density* of such weighted points: the mixture approximates pi(x) p(z_t | x), the
filtering density, not the likelihood. A smoother on it counts the past twice at every frame: its intervals are too narrow, and
its means are pulled towards the filter's. (In the paper the weights of components are meant to compensate for particles that
lie close together. They do so for components that lie close together, but the mixture is high where particles are dense.) The
weights used here are the history's, with which the particles of any filter represent its filtering density. Those of a filter
that resamples at every frame are the likelihoods.

**Corrections.** pi is known from the particles of the frame before.

* ``"none"``: the paper's.
* ``"weights"``: points weighted by w_i / pi(x_i) stand for p(z_t | x) where there are particles. Consistent as points multiply
  and components narrow, but a flat likelihood ends where the particles do, and in many dimensions few weights remain.
* ``"moments"``: fit as the paper does, then divide each component by the Gaussian of pi's moments: L_k = R_k^-1 - P^-1, flat in
  directions in which the quotient would grow outwards. One free component is exact for linear Gaussian models, up to the
  Monte Carlo error of moments. With that error the precision gained, relative to P^-1, is about g + N(0, s^2), s^2 = 2 / ESS,
  and where nothing is gained its positive part would add up over frames: it is shrunk by max(0, 1 - s^2 / g^2), as James and
  Stein do.

A frame of which nothing was seen has a flat likelihood whatever the correction.

**Predictions** for each frame, before that frame's data, are of the weighted particles (x_j, w_j) at the frame before:

    p(x_t | z_(<t)) = sum_j w_j p(x_t | x_j),
    m = sum_j w_j E[x_t | x_j],      P = cov_j E[x_t | x_j] + sum_j w_j Cov[x_t | x_j],

and the initial program's at the first frame. It is valid for any filter, whatever its particles of the frame itself were drawn
from.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.gaussians.gaussian import inverse_root
from poseppl.gaussians.mixture import GaussianMixture
from poseppl.gaussians.weighted_em import choose_seeds, fit_fixed, fit_free
from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import prepend, split_first, tree_index
from poseppl.particles.weights import normalise, weighted_covariance, weighted_mean
from poseppl.program import CompiledModel, Observation
from poseppl.program.population import log_initials, log_transition_matrix, transition_moments
from poseppl.smoothers.base import History

Covariance = Literal["fixed", "free"]
Correction = Literal["none", "weights", "moments"]


class MixtureSettings(NamedTuple):
    """How the likelihood is approximated.

    Attributes:
        num_components: K, the most components of a frame.
        covariance: "fixed" (one diagonal covariance for all components of a frame) or "free".
        scales: Standard deviations (d,) of fixed components, in the units of the flat state; None takes a frame's weighted
            standard deviations times (4 / ((d + 2) K))^(1 / (d + 4)), at most 1, with K the components that there are.
        correction: For the density of particles: "none", "weights" or "moments".
        num_steps: Rounds of expectation maximisation.
        num_predecessors: J, particles of the frame before that make up the density of ``"weights"``.
    """

    num_components: int = 50
    covariance: Covariance = "fixed"
    scales: Any = None
    correction: Correction = "moments"
    num_steps: int = 20
    num_predecessors: int = 200

    def check(self) -> MixtureSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(1, num_components=self.num_components, num_steps=self.num_steps, num_predecessors=self.num_predecessors)
        check_choice(Covariance, covariance=self.covariance)
        check_choice(Correction, correction=self.correction)
        return self


class LikelihoodMixture(NamedTuple):
    """K components for each of T frames; see the module. Functions of one frame take it without the leading axis.

    Attributes:
        log_heights: g_k (T, K), -inf where there is no component.
        anchors: a_k (T, K, d).
        gradients: b_k (T, K, d).
        precisions: L_k (T, K, d, d), or (T, 1, d, d) where all components of a frame share it.
    """

    log_heights: Array
    anchors: Array
    gradients: Array
    precisions: Array


def mixture_of_gaussians(log_weights: Any, means: Any, covariances: Any) -> LikelihoodMixture:
    """A mixture that is known: log-weights (T, K), means (T, K, d), covariances (T, K, d, d) or (T, 1, d, d)."""
    log_weights, means, covariances = (jnp.asarray(a) for a in (log_weights, means, covariances))
    roots = jnp.vectorize(inverse_root, signature="(i,j)->(i,j)")(covariances)
    constant = jnp.sum(jnp.log(jnp.diagonal(roots, axis1=-2, axis2=-1)), -1) - 0.5 * means.shape[-1] * jnp.log(2 * jnp.pi)
    return LikelihoodMixture(log_weights + constant, means, jnp.zeros_like(means), jnp.swapaxes(roots, -1, -2) @ roots)


def log_components(mixture: LikelihoodMixture, x: Array) -> Array:
    """Values log phi_k(x) (K,) of one frame's mixture at one state (d,)."""
    offset = x - mixture.anchors
    scaled = jnp.einsum("...ij,...j->...i", mixture.precisions, offset)
    return mixture.log_heights + jnp.sum((mixture.gradients - 0.5 * scaled) * offset, -1)


def fit_likelihood_mixture(
    rng_key: Array,
    model: CompiledModel,
    history: History,
    observations: Observation,
    inputs: Any,
    settings: MixtureSettings,
) -> LikelihoodMixture:
    """Approximate the likelihood of every frame.

    Args:
        rng_key: PRNG key.
        model: The compiled model, its initial and transition programs with Gaussian moments.
        history: The filter's.
        observations: Stacked data with leading T; only their masks are read.
        inputs: Stacked inputs with leading T, or None.
        settings: How.

    Raises:
        ValueError: The programs have no Gaussian moments, or a setting is out of range.
    """
    settings = settings.check()
    num_frames, num_particles, dimension = history.particles.shape
    key_density, key_frames = jax.random.split(rng_key)
    log_weights = history.log_weights
    if settings.correction == "weights":
        log_weights = log_weights - log_predicted(key_density, model, history, inputs, settings.num_predecessors)

    rows = _Frame(
        jax.random.split(key_frames, num_frames),
        history.particles,
        log_weights,
        *predicted_moments(model, history, inputs),
        _frames_seen(observations, num_frames),
    )
    wide = settings.num_components * (dimension if settings.covariance == "free" else 1)
    elements = num_particles * max(wide, dimension)
    mixture: LikelihoodMixture = map_frames(lambda row: _fit_frame(row, settings), rows, num_frames, elements)
    return mixture


class _Frame(NamedTuple):
    """Data of the fit of a frame: particles (N, d), log-weights (N,), the prediction's moments, whether it has data."""

    rng_key: Array
    particles: Array
    log_weights: Array
    mean: Array
    covariance: Array
    seen: Array


def _fit_frame(frame: _Frame, settings: MixtureSettings) -> LikelihoodMixture:
    """Fit one frame, in coordinates that are centred and scaled by its particles."""
    rng_key, particles, log_weights, mean, covariance, seen = frame
    normalised = normalise(log_weights)
    centre = weighted_mean(particles, log_weights)
    spread = jnp.sqrt(jnp.diagonal(weighted_covariance(particles, log_weights)))
    least = 1e-3 * jnp.sqrt(jnp.diagonal(covariance))
    unit = jnp.maximum(spread, least)
    points = jnp.where(normalised.weights[:, None] > 0, (particles - centre) / unit, 0.0)
    seeds, alive = choose_seeds(rng_key, normalised.log_weights, settings.num_components)
    if settings.covariance == "free":
        floor = (least / unit) ** 2 * (spread <= least)
        fitted = fit_free(points, normalised.weights, seeds, alive, settings.num_steps, floor)
    else:
        scales = _default_scales(alive, unit) if settings.scales is None else jnp.asarray(settings.scales, unit.dtype)
        fitted = fit_fixed(points, normalised.weights, seeds, alive, scales / unit, settings.num_steps)
    log_weights, means, covariances = fitted
    scaled = GaussianMixture(log_weights, centre + unit * means, covariances * unit[:, None] * unit)
    if settings.correction == "moments":
        mixture = _divide(scaled, mean, covariance, 2.0 / normalised.ess)
    else:
        mixture = mixture_of_gaussians(*scaled)
    flat = LikelihoodMixture(scaled.log_weights, mixture.anchors, *jax.tree.map(jnp.zeros_like, mixture[2:]))
    chosen: LikelihoodMixture = jax.tree.map(lambda nothing, fitted: jnp.where(seen, fitted, nothing), flat, mixture)
    return chosen


def _frames_seen(observations: Observation, num_frames: int) -> Array:
    """Whether anything was seen of each frame (T,)."""
    masks = [jnp.any(mask.reshape(num_frames, -1), 1) for mask in observations.mask.values()]
    return jnp.any(jnp.stack(masks), 0) if masks else jnp.ones(num_frames, bool)


def _default_scales(alive: Array, unit: Array) -> Array:
    """Silverman's rule for as many kernels as there are components."""
    d = unit.shape[0]
    count = jnp.maximum(jnp.sum(alive), 1).astype(unit.dtype)
    return unit * jnp.minimum((4.0 / ((d + 2) * count)) ** (1.0 / (d + 4)), 1.0)


def _divide(components: GaussianMixture, mean: Array, covariance: Array, noise: Array) -> LikelihoodMixture:
    """Divide Gaussians by N(mean, covariance); `noise` is the relative variance of their variances."""
    whiten = inverse_root(covariance)
    values, vectors = jnp.linalg.eigh(whiten @ components.covariances @ whiten.T)
    # in units of the prediction and along a component's axes: precision 1 / value - 1, gradient the distance from the mean
    gain = 1.0 / jnp.maximum(values, 1e-6) - 1.0
    shrink = jnp.where(gain > 0, jnp.maximum(1.0 - noise / jnp.where(gain > 0, gain, 1.0) ** 2, 0.0), 0.0)
    gain = shrink * gain
    distance = jnp.einsum(
        "kji,kj->ki",
        jnp.broadcast_to(vectors, (components.means.shape[0], *whiten.shape)),
        (components.means - mean) @ whiten.T,
    )
    axes = whiten.T @ vectors
    return LikelihoodMixture(
        log_heights=components.log_weights + 0.5 * jnp.sum(jnp.log1p(gain) + shrink * distance**2, -1),
        anchors=components.means,
        gradients=jnp.einsum(
            "kij,kj->ki", jnp.broadcast_to(axes, (components.means.shape[0], *whiten.shape)), shrink * distance
        ),
        precisions=jnp.einsum("cij,cj,ckj->cik", axes, gain, axes),
    )


_ELEMENTS = 2**24
"""Numbers that a batch of frames may keep at once."""


def map_frames(function: Any, arguments: Any, num_frames: int, elements: int) -> Any:
    """Apply a function of one frame to all, in batches of frames whose largest array, of `elements` a frame, fits in memory."""
    batch = max(1, min(num_frames, _ELEMENTS // max(elements, 1)))
    if batch == num_frames:
        return jax.vmap(function)(arguments)
    blocks = -(-num_frames // batch)
    rows = jnp.minimum(jnp.arange(blocks * batch), num_frames - 1).reshape(blocks, batch)
    mapped = jax.lax.map(lambda row: jax.vmap(function)(tree_index(arguments, row)), rows)
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:num_frames], mapped)


def predicted_moments(model: CompiledModel, history: History, inputs: Any) -> tuple[Array, Array]:
    """Mean (T, d) and covariance (T, d, d) of the prediction of every frame.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        history: The filter's.
        inputs: Stacked inputs with leading T, or None.

    Raises:
        ValueError: The programs have no Gaussian moments.
    """
    num_frames, num_particles, dimension = history.particles.shape
    first, later = split_first(inputs)
    mean, covariance = model.initial_moments(first)

    def predict(row: Any) -> tuple[Array, Array]:
        particles, log_weights, row_inputs = row
        means, covariances = transition_moments(model, particles, row_inputs)
        noise = jnp.tensordot(normalise(log_weights).weights, covariances, 1)
        return weighted_mean(means, log_weights), weighted_covariance(means, log_weights) + noise

    if num_frames == 1:
        return mean[None], covariance[None]
    rows = history.particles[:-1], history.log_weights[:-1], later
    means, covariances = map_frames(predict, rows, num_frames - 1, num_particles * dimension**2)
    return prepend((mean, covariance), (means, covariances))


def log_predicted(rng_key: Array, model: CompiledModel, history: History, inputs: Any, num_predecessors: int) -> Array:
    """Log-density (T, N) of every particle under the prediction of its frame, from a sample of the particles before.

    Args:
        rng_key: For the sample.
        model: The compiled model.
        history: The filter's.
        inputs: Stacked inputs with leading T, or None.
        num_predecessors: J, particles of the frame before, resampled by their weights.
    """
    num_frames, num_particles, _ = history.particles.shape
    first, later = split_first(inputs)
    start = log_initials(model, history.particles[0], first)
    if num_frames == 1:
        return start[None]
    size = min(num_predecessors, num_particles)

    def density(row: Any) -> Array:
        key, particles, before, log_weights, row_inputs = row
        chosen = before[systematic(key, log_weights, size)]
        return jax.nn.logsumexp(log_transition_matrix(model, particles, chosen, row_inputs), axis=1) - jnp.log(size)

    keys = jax.random.split(rng_key, num_frames - 1)
    rows = keys, history.particles[1:], history.particles[:-1], history.log_weights[:-1], later
    return jnp.concatenate([start[None], map_frames(density, rows, num_frames - 1, num_particles * size)])
