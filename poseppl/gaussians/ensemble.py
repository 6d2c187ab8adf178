r"""An ensemble of states as a Gaussian: what data do to it, and to any other ensemble of the same members.

With members x_i, their predicted data h_i = E[y | x_i], deviations X', Y' from the means, and R = mean of Cov[y | x_i],

    C_xy = \rho_xy o X'^T Y' / (N - 1),    S = \rho_yy o Y'^T Y' / (N - 1) + R = U U^T,    R = V V^T

(\rho tapers, or ones). In the stochastic form (Burgers, van Leeuwen and Evensen 1998,
doi:10.1175/1520-0493(1998)126<1719:ASITEK>2.0.CO;2) each member has data of its own, e_i ~ N(0, R) of mean zero,

    x_i + C_xy g_i,    g_i = S^-1 (y + e_i - h_i);

in the square-root form (Whitaker and Hamill 2002, doi:10.1175/1520-0493(2002)130<1913:EDAWPO>2.0.CO;2, whose Eq. 10 is true for
any square roots: Andrews 1968) nothing is drawn,

    g_i = S^-1 (y - mean h) - U^-T (U + V)^-1 Y'_i,

and without tapers mean and covariance of the members are exactly Kalman's update of their mean and covariance: with
G = C_xy U^-T (U + V)^-1, -G C_yx - C_xy G^T + G (U U^T - V V^T) G^T = -C_xy S^-1 C_yx. Both are linear in C_xy, so that the
same weights g move the members' states of any frame (the ensemble Kalman smoother).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import diagonal, lower_inverse

Form = Literal["square-root", "stochastic"]


class PredictedData(NamedTuple):
    """Data as the members predict them; entries that were not seen say nothing.

    Attributes:
        deviations: Y' (N, k), 0 where nothing was seen.
        residual: Data less their predicted mean (k,), 0 where nothing was seen.
        noise: R (k, k), the identity where nothing was seen.
        num_seen: Number of entries that were seen, a scalar.
    """

    deviations: Array
    residual: Array
    noise: Array
    num_seen: Array


class Increment(NamedTuple):
    """The update of an ensemble by a frame's data.

    Attributes:
        weights: g (N, k).
        deviations: Y' (N, k).
        log_evidence: Log-density of the data under N(mean h, S), a scalar.
    """

    weights: Array
    deviations: Array
    log_evidence: Array


def predicted_data(means: Array, noises: Array, data: Array, seen: Array) -> PredictedData:
    """Compare predictions with data.

    Args:
        means: E[y | x_i] (N, k).
        noises: Cov[y | x_i] (N, k, k).
        data: y (k,).
        seen: Booleans (k,).
    """
    mean = jnp.mean(means, 0)
    noise = jnp.where(seen[:, None] & seen, jnp.mean(noises, 0), jnp.eye(data.shape[0], dtype=data.dtype))
    return PredictedData(
        jnp.where(seen, means - mean, 0.0),
        jnp.where(seen, data - mean, 0.0),
        noise,
        jnp.sum(seen).astype(data.dtype),
    )


def increment(rng_key: Array, predicted: PredictedData, form: Form, taper: Array | None = None) -> Increment:
    """Update an ensemble by the data that it predicted.

    Args:
        rng_key: For the members' own data, in the stochastic form.
        predicted: Data as the members predict them.
        form: "square-root" or "stochastic".
        taper: rho_yy (k, k), or None.
    """
    deviations, residual, noise, num_seen = predicted
    covariance = _tapered(deviations.T @ deviations / (len(deviations) - 1), taper) + noise
    upper, lower = jnp.linalg.cholesky(covariance), jnp.linalg.cholesky(noise)
    whiten = lower_inverse(upper)
    if form == "stochastic":
        drawn = jax.random.normal(rng_key, deviations.shape, deviations.dtype) @ lower.T
        # entries that were not seen have no weight, for their deviations are 0
        own = residual + drawn - jnp.mean(drawn, 0) - deviations
        weights = own @ whiten.T @ whiten
    else:
        weights = (whiten @ residual - deviations @ lower_inverse(upper + lower).T) @ whiten
    white = whiten @ residual
    log_evidence = -0.5 * (white @ white + num_seen * jnp.log(2 * jnp.pi)) - jnp.sum(jnp.log(diagonal(upper)))
    return Increment(weights, deviations, log_evidence)


def moved(members: Array, by: Increment, taper: Array | None = None) -> Array:
    """States (N, d) of the members at this frame or another, after the data; rho_xy (d, k), or None."""
    deviations = members - jnp.mean(members, 0)
    if taper is None:
        return members + (by.weights @ by.deviations.T / (len(members) - 1)) @ deviations
    covariance = _tapered(deviations.T @ by.deviations / (len(members) - 1), taper)
    return members + by.weights @ covariance.T


def inflated(members: Array, factor: Array) -> Array:
    """Members (N, d) with their deviations multiplied by a factor, a scalar or (d,)."""
    mean = jnp.mean(members, 0)
    return mean + factor * (members - mean)


def relaxed(members: Array, prior: Array, share: float) -> Array:
    """Members (N, d) whose spread is brought back a share of the way to that of the prediction (N, d).

    Relaxation to prior spread of Whitaker and Hamill 2012 (doi:10.1175/MWR-D-11-00276.1): deviations times
    share (s_prior - s) / s + 1, s the standard deviation of a coordinate.
    """
    after, before = _spread(members), _spread(prior)
    known = after > 0
    return inflated(members, jnp.where(known, share * (before - after) / jnp.where(known, after, 1.0) + 1.0, 1.0))


def adapted_inflation(inflation: Array, predicted: PredictedData, drift: float) -> Array:
    """The factor of the prediction's standard deviation that the innovations speak for.

    Li, Kalnay and Miyoshi 2009 (doi:10.1002/qj.371), with the variances of Miyoshi 2011 (doi:10.1175/2010MWR3570.1). Let r be
    the residual, p the number of observed entries and s = tr(R^-1 C_yy) / p for the deviations before inflation. The factor b
    of the covariance is observed as (r^T R^-1 r / p - 1) / s with variance 2 / p ((b s + 1) / s)^2, and estimated by a scalar
    Kalman update.

    Args:
        inflation: The factor up to now, a scalar, at least 1.
        predicted: Data as the members predict them without inflation.
        drift: Standard deviation by which the covariance's factor may change from frame to frame.

    Returns:
        The factor for the next frame, at least 1.
    """
    deviations, residual, noise, num_seen = predicted
    whiten = lower_inverse(jnp.linalg.cholesky(noise))
    many = jnp.maximum(num_seen, 1.0)
    spread = jnp.sum((deviations @ whiten.T) ** 2) / (len(deviations) - 1) / many
    informative = (num_seen > 0) & (spread > 0)
    spread = jnp.where(informative, spread, 1.0)
    before = inflation**2
    observed = (jnp.sum((whiten @ residual) ** 2) / many - 1.0) / spread
    variance = 2.0 / many * ((before * spread + 1.0) / spread) ** 2
    after = before + drift**2 / (drift**2 + variance) * (observed - before)
    return jnp.where(informative & jnp.isfinite(after), jnp.sqrt(jnp.maximum(after, 1.0)), inflation)


def _tapered(covariance: Array, taper: Array | None) -> Array:
    return covariance if taper is None else covariance * taper


def _spread(members: Array) -> Array:
    """Standard deviations (d,); where all members are alike 0, with a derivative of 0."""
    variance = jnp.var(members, 0)
    return jnp.where(variance > 0, jnp.sqrt(jnp.where(variance > 0, variance, 1.0)), 0.0)
