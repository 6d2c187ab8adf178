r"""Moves of one frame's state given its neighbours, for Gibbs sampling on a mixture approximation of the likelihood.

The full conditional of x_t and its component s_t is, with phi of :mod:`poseppl.smoothers.published.likelihood_mixture`,

    p(x_t, s_t | x_(t-1), x_(t+1)) ~ p(x_t | x_(t-1)) phi_(s_t)(x_t) p(x_(t+1) | x_t).

A move draws s_t = k and then x_t from a Gaussian, and accepts by Metropolis and Hastings. With W the precision of the
transition around its mean m, and that into the next frame linearised at o_k, N(x_(t+1); f_k + F_k (x - o_k), S_k^-1), the
Gaussian has

    precision V_k = W + L_k + F_k^T S_k F_k,      mean m + V_k^-1 c_k,
    c_k = b_k - L_k (m - a_k) + F_k^T S_k (x_(t+1) - f_k - F_k (m - o_k)),

and what is left for the acceptance is how far the true factors are from those in the proposal: nothing for linear Gaussian
transitions. These moves alternate at random:

* *joint*: k by its mass, phi_k(m) exp(c_k^T V_k^-1 c_k / 2) |V_k|^(-1/2), x_t integrated out. Chains change components however
  far these lie apart. The next frame is left out of the proposal where the transition is not linear.
* *local*: k given the current x_t, phi_k(x_t), as in Gibbs sampling proper, and the transition linearised at o_k = a_k.
* *plain*, only when the likelihood itself is sampled from: without phi, so that a mixture that is too low somewhere does not
  trap a chain.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import precision_of
from poseppl.gaussians.linear_transitions import LinearTransitions, Structure, transition_around
from poseppl.kernels.laplace import whitening
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.published.likelihood_mixture import LikelihoodMixture, log_components

_PLAIN = 0.2
"""Share of plain moves."""


class Scales(NamedTuple):
    """Square roots of V_k^-1 of one frame, for each kind of move.

    Attributes:
        joint: For the joint moves (K, d, d), or (1, d, d) where components share it.
        local: For the local moves, likewise.
        plain: For the plain moves (d, d).
    """

    joint: Array
    local: Array
    plain: Array


class Frames(NamedTuple):
    """Constants of the moves of T frames; functions of one frame take a row of it.

    Attributes:
        mixture: Mixture of the likelihood.
        first: Whether there is no frame before (T,).
        last: Whether there is no frame after (T,).
        inputs: Inputs of the frame.
        next_inputs: Inputs of the frame after.
        observation: Data of the frame.
        ahead: The transition into the next frame, around the anchors (T, K, ...), or (T, 1, ...) where it is linear; its
            precisions are 0 at the last frame.
        precision: W (T, d, d), or None where it depends on the state before.
        scales: Square roots of V_k^-1, or None where W is.
    """

    mixture: LikelihoodMixture
    first: Array
    last: Array
    inputs: Any
    next_inputs: Any
    observation: Observation
    ahead: LinearTransitions
    precision: Array | None
    scales: Scales | None


class Settings(NamedTuple):
    """Which moves: see :func:`poseppl.smoothers.published.gibbs.gibbs_smoother`."""

    linear: bool
    collapsed: bool
    true_likelihood: bool


class _Proposal(NamedTuple):
    """k, the Gaussian's mean (d,) and its scale (d, d), and what of it the acceptance has to know."""

    component: Array
    mean: Array
    scale: Array
    looks_ahead: Array
    with_mixture: Array


def prepare_frames(
    model: CompiledModel, mixture: LikelihoodMixture, observations: Observation, inputs: Any, structure: Structure
) -> Frames:
    """Gather what does not change from round to round."""
    num_frames = mixture.anchors.shape[0]
    place = jnp.arange(num_frames)
    following = jnp.minimum(place + 1, num_frames - 1)
    next_inputs = tree_index(inputs, following)
    origins = mixture.anchors[:, :1] if structure.linear else mixture.anchors
    ahead = jax.vmap(lambda rows, i: jax.vmap(lambda x: transition_around(model, x, i))(rows))(origins, next_inputs)
    last = place == num_frames - 1
    ahead = ahead._replace(precisions=jnp.where(last[:, None, None, None], 0.0, ahead.precisions))
    frames = Frames(mixture, place == 0, last, inputs, next_inputs, observations, ahead, None, None)
    if not structure.constant:
        return frames
    anywhere = mixture.anchors[:, 0]
    _, precision = jax.vmap(lambda x, frame: _prior(model, x, frame))(anywhere, frames)
    scales = jax.vmap(lambda w, frame: _scales(w, frame, linear=structure.linear))(precision, frames)
    return frames._replace(precision=precision, scales=scales)


def _scales(precision: Array, frame: Frames, *, linear: bool) -> Scales:
    curvatures = precision + frame.mixture.precisions
    ahead = jnp.einsum("kji,kjl,klm->kim", frame.ahead.jacobians, frame.ahead.precisions, frame.ahead.jacobians)
    local = jax.vmap(_scale)(curvatures + ahead)
    return Scales(
        local if linear else jax.vmap(_scale)(curvatures), local, _scale(precision + ahead[0] if linear else precision)
    )


def _scale(precision: Array) -> Array:
    return whitening(precision[0], precision).scale


def move_frame(
    model: CompiledModel,
    settings: Settings,
    rng_key: Array,
    x: Array,
    before: Array,
    after: Array,
    frame: Frames,
) -> tuple[Array, Array]:
    """Move one frame's state (d,) given its neighbours (d,); returns it and the acceptance probability."""
    key_propose, key_noise, key_accept = jax.random.split(rng_key, 3)
    mean, precision = _prior(model, before, frame)
    proposal = _propose(settings, key_propose, x, after, mean, precision, frame)
    moved = proposal.mean + proposal.scale @ jax.random.normal(key_noise, x.shape, x.dtype)

    def rest(x: Array) -> Array:
        return _left_out(model, settings, x, before, after, mean, precision, frame, proposal)

    new, old = jax.vmap(rest)(jnp.stack([moved, x]))
    log_ratio = new - old
    log_ratio = nan_to_neg_inf(log_ratio)
    accepted = jnp.log(jax.random.uniform(key_accept, dtype=x.dtype)) < log_ratio
    return jnp.where(accepted, moved, x), jnp.exp(jnp.minimum(log_ratio, 0.0))


def _prior(model: CompiledModel, before: Array, frame: Frames) -> tuple[Array, Array]:
    """Mean (d,) and precision (d, d) given the frame before, or at the start."""
    start, moved = model.initial_moments(frame.inputs), model.transition_moments(before, frame.inputs)
    mean, covariance = jax.tree.map(lambda a, b: jnp.where(frame.first, a, b), start, moved)
    return mean, precision_of(covariance) if frame.precision is None else frame.precision


def _propose(
    settings: Settings,
    rng_key: Array,
    x: Array,
    after: Array,
    mean: Array,
    precision: Array,
    frame: Frames,
) -> _Proposal:
    key_component, key_kind, key_plain = jax.random.split(rng_key, 3)
    mixture, ahead, linear = frame.mixture, frame.ahead, settings.linear
    scales = frame.scales or _scales(precision, frame, linear=linear)
    gradients = mixture.gradients - _matvec(mixture.precisions, mean - mixture.anchors)
    residual = after - ahead.means - _matvec(ahead.jacobians, mean - mixture.anchors[: ahead.means.shape[0]])
    gradients_ahead = jnp.einsum("kji,kjl,kl->ki", ahead.jacobians, ahead.precisions, residual)
    local = jnp.asarray(not settings.collapsed)
    if settings.collapsed and not linear:
        local = jax.random.bernoulli(key_kind)
    plain = jax.random.bernoulli(key_plain, _PLAIN) if settings.true_likelihood else jnp.asarray(False)
    looks_ahead = (local & ~plain) | linear
    logits = log_components(mixture, x)
    if settings.collapsed:
        white = _matvec(jnp.swapaxes(scales.joint, 1, 2), gradients + gradients_ahead if linear else gradients)
        volumes = jnp.sum(jnp.log(jnp.diagonal(scales.joint, axis1=1, axis2=2)), -1)
        masses = log_components(mixture, mean) + 0.5 * jnp.sum(white**2, -1) + volumes
        logits = jnp.where(local, logits, masses)
    k = jax.random.categorical(key_component, logits)
    gradient = jnp.where(plain, 0.0, gradients[k]) + jnp.where(looks_ahead, _row(gradients_ahead, k), 0.0)
    scale = jnp.where(local, _row(scales.local, k), _row(scales.joint, k))
    scale = jnp.where(plain, scales.plain, scale)
    return _Proposal(k, mean + scale @ (scale.T @ gradient), scale, looks_ahead, ~plain)


def _left_out(
    model: CompiledModel,
    settings: Settings,
    x: Array,
    before: Array,
    after: Array,
    mean: Array,
    precision: Array,
    frame: Frames,
    proposal: _Proposal,
) -> Array:
    """Logarithm of the target over the proposal, as far as it depends on the state (d,)."""
    k, ahead, anchors = proposal.component, frame.ahead, frame.mixture.anchors
    prior = jnp.where(frame.first, model.log_initial(x, frame.inputs), model.log_transition(x, before, frame.inputs)) + 0.5 * (
        x - mean
    ) @ precision @ (x - mean)
    origin = _row(anchors[: ahead.means.shape[0]], k)
    residual = after - _row(ahead.means, k) - _row(ahead.jacobians, k) @ (x - origin)
    assumed = -0.5 * residual @ _row(ahead.precisions, k) @ residual
    coming = jnp.where(frame.last, 0.0, model.log_transition(after, x, frame.next_inputs))
    total = prior + coming - jnp.where(proposal.looks_ahead, assumed, 0.0)
    if settings.true_likelihood:
        approximate = jax.nn.logsumexp(log_components(frame.mixture, x))
        total = total + model.log_observation(x, frame.observation, frame.inputs)
        total = total - jnp.where(proposal.with_mixture, approximate, 0.0)
    return total


def _matvec(matrices: Array, vectors: Array) -> Array:
    """Products (K, d) of matrices (K, d, d) or (1, d, d) with vectors (K, d) or (1, d)."""
    if matrices.shape[0] == 1:
        return vectors @ matrices[0].T
    return jnp.einsum("kij,kj->ki", matrices, jnp.broadcast_to(vectors, matrices.shape[:2]))


def _row(rows: Array, k: Array) -> Array:
    """Row k, or the one there is."""
    return rows[jnp.minimum(k, rows.shape[0] - 1)]
