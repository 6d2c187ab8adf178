"""Gaussian summaries of distributions and of the observation program: moments, curvature.

The curvature is Gauss-Newton's. For Gaussian sites with location mu(x) and precision R^-1, and other sites or factors l(x),

    I(x) = J^T R^-1 J + [-d2 l / dx2]_+ ,      J = d mu / d x,

without the terms from a scale that depends on x; [.]_+ clips negative eigenvalues to 0. For Gaussian sites of constant scale
it is the Fisher information, so it never has negative eigenvalues. Derivatives are reverse mode throughout: models may define
their own reverse rules.

A distribution that is a :class:`~poseppl.program.closed_forms.WhitenedJacobian` is asked for R^(-1/2) J, and one with
:class:`~poseppl.program.closed_forms.CurvatureRows` for these. Robust sites
(:mod:`poseppl.program.robust_errors`) with whitened residuals r and their direction u weigh the rows of each,

    J^T R^(-1/2) (rho' (1 - u u^T) + [rho' + 2 rho'' r^T r]_+ u u^T) R^(-1/2) J.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array
from jax.scipy.linalg import block_diag, solve_triangular

from poseppl.errors import UnsuitableModelError
from poseppl.program.closed_forms import CurvatureRows, WhitenedJacobian
from poseppl.program.dependence import output_dependence
from poseppl.program.execution import any_event_mask, is_masked, site_log_density, unwrap
from poseppl.program.normal_sites import is_plain
from poseppl.program.partly_seen import whitening_factor
from poseppl.program.robust_errors import RobustError

TraceOf = Callable[[Array], dict[str, dict[str, Any]]]


def moments(distribution: dist.Distribution, shape: tuple[int, ...] | None = None) -> tuple[Array, Array]:
    """Mean (n,), and variances (n,) or covariance (n, n), of a distribution over n = product of its shape entries.

    With a ``shape`` of its value, the distribution is expanded to it.

    An angle's (VonMises) variance is that of the wrapped normal with the same resultant length, -2 log R. A negative scale has
    no variance (NaN), as it has no density, though its square is one.

    Raises:
        ValueError: A multivariate distribution without a known covariance.
    """
    base = unwrap(distribution)
    shape = distribution.shape() if shape is None else shape
    dtype = jnp.result_type(float)
    if isinstance(base, dist.VonMises):
        mean, variance = base.loc, -2.0 * jnp.log1p(-base.variance)
    elif base.event_dim == 0:
        mean, variance = base.mean, base.variance
        if hasattr(base, "scale"):
            variance = jnp.where(base.scale < 0, jnp.nan, variance)
    elif base.event_dim == 1 and hasattr(base, "covariance_matrix"):
        size = shape[-1]
        mean = jnp.broadcast_to(base.mean, shape)
        blocks = jnp.broadcast_to(base.covariance_matrix, (*shape, size)).reshape(-1, size, size)
        return jnp.ravel(mean).astype(dtype), block_diag(*blocks).astype(dtype)
    else:
        raise ValueError(f"{type(base).__name__} does not give its covariance matrix")
    mean, variance = (jnp.ravel(jnp.broadcast_to(a, shape)).astype(dtype) for a in (mean, variance))
    return mean, variance


def is_gaussian(trace: Mapping[str, Any]) -> bool:
    """Whether a program's density is the Gaussian of its moments, if these have no obstacle."""
    kinds = dist.Normal, dist.MultivariateNormal
    return all(is_plain(site, *kinds) for site in trace.values() if site["type"] == "sample")


def joint_moments(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Mean and covariance of what is independent, in order, from the :func:`moments` of each."""
    mean = jnp.concatenate([mean for mean, _ in parts])
    if all(spread.ndim == 1 for _, spread in parts):
        return mean, jnp.diag(jnp.concatenate([variance for _, variance in parts]))
    return mean, block_diag(*(jnp.diag(spread) if spread.ndim == 1 else spread for _, spread in parts))


def flat_observation(sites: Mapping[str, Any], values: Mapping[str, Array], mask: Mapping[str, Array]) -> tuple[Array, Array]:
    """Data (k,) of all sites in order, and whether each entry was seen (k,)."""
    dtype = jnp.result_type(float)
    flat = jnp.concatenate([jnp.ravel(values[name]).astype(dtype) for name in sites])
    return flat, jnp.concatenate([jnp.ravel(mask[name]) for name in sites])


def observation_moments(sites: Mapping[str, Any], trace: Mapping[str, Any]) -> tuple[Array, Array]:
    """Mean (k,) and covariance (k, k) of the data of a frame, all sites in order.

    Raises:
        UnsuitableModelError: A site that is not Gaussian, is scaled or masked, or is a factor.
    """
    parts = []
    for name, site in trace.items():
        if site["type"] != "sample":
            continue
        gaussian = isinstance(unwrap(site["fn"]), dist.Normal | dist.MultivariateNormal | dist.Delta)
        if name not in sites or not gaussian or site.get("scale") is not None:
            raise UnsuitableModelError(
                f"The observation program has no Gaussian moments: site {name!r} is no plain Normal or MultivariateNormal. Use "
                "an algorithm that evaluates the likelihood (particle, tempered or HMC filters)."
            )
        if is_masked(site["fn"]):
            raise UnsuitableModelError(
                f"The observation program masks the site {name!r} itself, which its Gaussian moments do not include. Leave the "
                "mask out, with NaN for the data that it hides, or use an algorithm that evaluates the likelihood (particle, "
                "tempered or HMC filters)."
            )
        parts.append(moments(site["fn"]))
    return joint_moments(parts)


def observation_jacobian(sites: Mapping[str, Any], trace_of: TraceOf, x: Array) -> Array:
    """Derivative (k, d) of the mean of the data of a frame, all sites in order; in closed form where it is known.

    Args:
        sites: The Gaussian sites of the observation program.
        trace_of: Trace of the program at a flat state.
        x: Flat state (d,).
    """
    trace = trace_of(x)
    return jnp.concatenate([_mean_jacobian(trace_of, trace[name], x) for name in sites])


def observation_information(
    trace_of: TraceOf,
    mask: Mapping[str, Array],
    x: Array,
    *,
    majorised: Array | bool = False,
    spread: Array | None = None,
    left_out: frozenset[str] = frozenset(),
) -> Array:
    """Gauss-Newton curvature (d, d) of -log p(z | x).

    Args:
        trace_of: Trace of the observation program, data substituted, at a flat state.
        mask: Booleans of the value's shape for each site.
        x: Flat state (d,).
        majorised: Whether that of a robust site is of the quadratic that touches its potential from above, of which a step
            never goes too far.
        spread: Covariance (d, d) of the state about `x`: that of a robust site is then evaluated at the expected squared
            errors, not at those of `x` alone.
        left_out: Sites that are not counted.
    """
    residual: list[str] = []
    other: list[str] = []
    trace = trace_of(x)
    for name, site in trace.items():
        if site["type"] == "sample" and name not in left_out:
            has_residual = isinstance(unwrap(site["fn"]), dist.Normal | dist.MultivariateNormal | RobustError)
            (residual if has_residual else other).append(name)
    information = jnp.zeros((x.shape[0], x.shape[0]), x.dtype)
    for name in residual:
        jacobian = _whitened_jacobian(trace_of, name, mask.get(name), x)
        if isinstance(unwrap(trace[name]["fn"]), RobustError):
            jacobian = (
                _robust_rows(trace[name], jacobian, majorised)
                if spread is None
                else _expected_rows(trace[name], jacobian, spread)
            )
        information = information + jacobian.T @ jacobian
    if other:

        def log_density(state: Array) -> Array:
            trace = trace_of(state)
            return sum((site_log_density(trace[name], mask.get(name)) for name in other), start=jnp.zeros((), x.dtype))

        hessian = -jax.jacrev(jax.grad(log_density))(x)
        values, vectors = jnp.linalg.eigh((hessian + hessian.T) / 2)
        information = information + (vectors * jnp.maximum(values, 0.0)) @ vectors.T
    return information


def _whitened_jacobian(trace_of: TraceOf, name: str, mask: Array | None, x: Array) -> Array:
    """R^(-1/2) J of one Gaussian site, (events, d)."""
    here = trace_of(x)[name]
    known = _closed_form(trace_of, here, mask, x, curved=True)
    if known is not None:
        return known
    jacobian: Array = jax.jacrev(lambda state: _whitened_location(trace_of(state)[name], mask, here))(x)
    return jacobian


def _expected_rows(site: Mapping[str, Any], jacobian: Array, spread: Array) -> Array:
    """Rows of R^(-1/2) J (events, d), weighed by a robust site's curvature at the expected outer product of its errors."""
    errors = unwrap(site["fn"])
    white = errors.whitened_residual(site["value"]).reshape(-1, errors.size)
    rows = jacobian.reshape(*white.shape, -1)
    outer = white[:, :, None] * white[:, None] + jnp.einsum("end,dc,emc->enm", rows, spread, rows)
    squared = jnp.trace(outer, axis1=1, axis2=2)
    derivatives = errors.derivatives(squared.reshape(errors.batch_shape))
    first, second = (jnp.broadcast_to(jnp.ravel(each), squared.shape)[:, None, None] for each in derivatives)
    values, vectors = jnp.linalg.eigh(first * jnp.eye(errors.size, dtype=outer.dtype) + 2.0 * second * outer)
    root = vectors * jnp.sqrt(jnp.maximum(values, 0.0))[:, None]
    weighed: Array = jnp.einsum("emn,emd->end", root, rows).reshape(jacobian.shape)
    return weighed


def _robust_rows(site: Mapping[str, Any], jacobian: Array, majorised: Array | bool) -> Array:
    """Rows of R^(-1/2) J (events, d), weighed so that their square is the curvature of a robust site."""
    errors = unwrap(site["fn"])
    white = errors.whitened_residual(site["value"])
    squared = jnp.sum(white**2, -1)
    across, second = (jnp.ravel(jnp.broadcast_to(weight, squared.shape)) for weight in errors.derivatives(squared))
    white, squared = white.reshape(-1, white.shape[-1]), jnp.ravel(squared)
    along = jnp.where(majorised, across, jnp.maximum(across + 2.0 * second * squared, 0.0))
    unit = white / jnp.sqrt(jnp.where(squared > 0, squared, 1.0))[:, None]
    shrunk = 1.0 - _root(along / jnp.where(across > 0, across, 1.0))
    rows = jacobian.reshape(*white.shape, -1)
    inward = jnp.sum(unit[:, :, None] * rows, 1)
    rows = rows - shrunk[:, None, None] * unit[:, :, None] * inward[:, None]
    weighed: Array = (_root(across)[:, None, None] * rows).reshape(jacobian.shape)
    return weighed


def _root(values: Array) -> Array:
    """Square root whose derivative is 0 at 0, where weights end up that are clipped."""
    return jnp.where(values > 0, jnp.sqrt(jnp.where(values > 0, values, 1.0)), 0.0)


def _mean_jacobian(trace_of: TraceOf, site: Mapping[str, Any], x: Array) -> Array:
    """J of one Gaussian site, (events, d)."""
    known, scale = _closed_form(trace_of, site, None, x), getattr(site["fn"], "scale", None)
    if known is not None and scale is not None:
        return known * jnp.ravel(jnp.broadcast_to(scale, site["fn"].shape()))[:, None]
    jacobian: Array = jax.jacrev(lambda state: moments(trace_of(state)[site["name"]]["fn"])[0])(x)
    return jacobian


def _closed_form(
    trace_of: TraceOf, site: Mapping[str, Any], mask: Array | None, x: Array, *, curved: bool = False
) -> Array | None:
    """R^(-1/2) J as the site's distribution knows it, or rows of its own curvature; None if it does not."""
    known = _gaussian_of(site["fn"])
    if not isinstance(known, WhitenedJacobian) or site.get("scale") is not None:
        return None
    name = site["name"]
    fixed = jax.make_jaxpr(lambda state: jax.tree.leaves(_gaussian_of(trace_of(state)[name]["fn"]).fixed))(x)
    if any(output_dependence(fixed, [frozenset({0})])):
        return None
    _, pull_back = jax.vjp(lambda state: _gaussian_of(trace_of(state)[name]["fn"]).state, x)
    if mask is not None and site["fn"].event_dim:
        mask = jnp.broadcast_to(jnp.all(mask, -1, keepdims=True), mask.shape)
    own = known.curvature_rows if curved and isinstance(known, CurvatureRows) else known.whitened_jacobian
    rows: Array = jax.vmap(pull_back)(own(mask))[0]
    return rows


def _gaussian_of(distribution: dist.Distribution) -> Any:
    """The Gaussian that a distribution is, or that it bends."""
    return distribution.gaussian if isinstance(distribution, RobustError) else distribution


def _whitened_location(site: Mapping[str, Any], mask: Array | None, here: Mapping[str, Any]) -> Array:
    """R^(-1/2) mu, flat, with 0 for masked events, R that of the site ``here``; its Jacobian's square is the information."""
    distribution = site["fn"]
    base, shape, fixed = _gaussian_of(unwrap(distribution)), distribution.shape(), _gaussian_of(unwrap(here["fn"]))
    location = jnp.broadcast_to(base.loc, shape)
    if isinstance(base, dist.Normal):
        white = location / jnp.broadcast_to(fixed.scale, shape)
    else:
        lower = whitening_factor(fixed, shape, mask)
        left = location if mask is None else jnp.where(mask, location, 0.0)
        white = solve_triangular(lower, left[..., None], lower=True)[..., 0]
    seen = jnp.ones(shape, bool)
    if mask is not None:
        seen = seen & _over_events(any_event_mask(mask, distribution), distribution)
    if site.get("scale") is not None:
        white = white * jnp.sqrt(_over_events(jnp.asarray(site["scale"]), distribution))
    while isinstance(distribution, dist.Independent | dist.MaskedDistribution | dist.ExpandedDistribution):
        if isinstance(distribution, dist.MaskedDistribution):
            seen = seen & _over_events(jnp.asarray(distribution._mask), distribution)
        distribution = distribution.base_dist
    return jnp.ravel(jnp.where(seen, white, 0.0))


def _over_events(batch: Array, distribution: dist.Distribution) -> Array:
    """Append the event axes of a distribution to an array over its batch axes, for broadcasting."""
    return batch.reshape(batch.shape + (1,) * distribution.event_dim) if batch.ndim else batch
