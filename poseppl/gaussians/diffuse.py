r"""Gaussians with directions that nothing is known of, and conditioning that stays exact where noise or knowledge is none.

    x = m + B \delta + L w,    w ~ N(0, 1),    \delta flat on R^q.

The limit of an initial variance \kappa that goes to infinity (Durbin and Koopman 2012, chapter 5) in the form of de Jong 1991
(doi:10.1214/aos/1176348139), by roots. Data y = m_y + b \delta + l w are taken in one entry after the other:

* b is not 0: the entry fixes one direction of \delta, \delta_1 = (y - m_y - l w) / |b|, and adds -log |b| to the log-density;
* else l is not 0: the usual conditioning, of which the entry fixes one direction of w;
* else the entry is known already: it adds nothing if it is as it has to be, and is impossible if it is not.

Each rotates \delta or w by a Householder reflection so that one column alone is seen, and drops that column. The log-density of
diffuse entries is that of Durbin and Koopman, the limit of log p + (q / 2) log \kappa, as statsmodels has it.

Rounding leaves a little of what is 0: rows are 0 below 16 epsilon of what they were made of. Before each frame the units of
\delta are chosen by the largest entry of each column of B, or a direction of small units would be taken for rounding.

>>> unknown = DiffuseGaussian(jnp.zeros(1), jnp.zeros((1, 1)), jnp.ones((1, 1)), jnp.zeros(()))
>>> sensor = Linear(jnp.zeros(1), jnp.ones((1, 1)), 4 * jnp.eye(1))
>>> found, log_density = condition_exactly(unknown, sensor, jnp.array([3.0]), jnp.array([True]))
>>> print(found.mean, found.scale, found.diffuse, round(float(log_density), 4))
[3.] [[2.]] [[0.]] -0.9189
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.gaussians.gaussian import Linear, RootGaussian, semidefinite_root, triangular

UNKNOWN = 1e15
"""Standard deviation that a direction of \\delta is reported with while nothing is known of it."""
_ROUNDED = 16
"""Units of rounding below which a row is 0."""
_SINGULAR = 256
"""Units of rounding by which a datum may differ from what it has to be."""


class DiffuseGaussian(NamedTuple):
    r"""A Gaussian of which some directions are not known.

    Attributes:
        mean: m (d,).
        scale: L (d, d), lower triangular.
        diffuse: B (d, q), whose columns are 0 once they are known.
        log_unit: Logarithm of the units of \delta that the log-density has not yet counted, a scalar.
    """

    mean: Array
    scale: Array
    diffuse: Array
    log_unit: Array

    @property
    def proper(self) -> RootGaussian:
        """The Gaussian, with a standard deviation of 10^15 in the directions that nothing is known of."""

        def root(scale: Array, diffuse: Array) -> Array:
            return triangular(jnp.hstack([scale, UNKNOWN * diffuse]))

        batched = root if self.mean.ndim == 1 else jax.vmap(root)
        return RootGaussian(self.mean, batched(self.scale, self.diffuse))

    @property
    def covariance(self) -> Array:
        """(..., d, d) of the same."""
        return self.proper.covariance


def diffuse_gaussian(mean: Array, covariance: Array, unknown: tuple[bool, ...]) -> DiffuseGaussian:
    """A start of mean (d,) and covariance (d, d), of which the coordinates in `unknown` (d,) are diffuse."""
    apart = np.asarray(unknown, bool)
    known = jnp.where(apart[:, None] | apart, 0.0, covariance)
    diffuse = jnp.asarray(np.eye(len(apart))[:, apart], mean.dtype)
    return DiffuseGaussian(mean, semidefinite_root(known), diffuse, jnp.zeros((), mean.dtype))


def predict_exactly(x: DiffuseGaussian, linear: Linear) -> DiffuseGaussian:
    """Distribution of y."""
    noise = semidefinite_root(linear.noise)
    moved = _rounded(linear.jacobian @ x.scale, jnp.abs(linear.jacobian) @ _norms(x.scale))
    diffuse = _rounded(linear.jacobian @ x.diffuse, jnp.abs(linear.jacobian) @ _norms(x.diffuse))
    return DiffuseGaussian(linear.mean, triangular(jnp.hstack([moved, noise])), diffuse, x.log_unit)


def condition_exactly(x: DiffuseGaussian, linear: Linear, y: Array, seen: Array) -> tuple[DiffuseGaussian, Array]:
    """Distribution of x given the seen entries of y.

    Args:
        x: The prior.
        linear: The conditional of y, whose noise may be singular, or 0.
        y: Data (k,).
        seen: Booleans (k,).

    Returns:
        The posterior, and the log-density of the seen data, a scalar; -inf where data that are known already are others.
    """
    noise = semidefinite_root(jnp.where(seen[:, None] & seen, linear.noise, 0.0))
    exact = ~jnp.any(noise != 0, 1)
    size = jnp.abs(linear.mean) + jnp.abs(linear.jacobian) @ jnp.abs(x.mean) + jnp.abs(y)
    x = _in_new_units(x)
    left, log_density = _eliminate(_joint(x, linear, noise), y, seen, exact, size)
    count = len(y)
    fixed = jnp.sum(jnp.any(left.diffuse != 0, 0)) < jnp.sum(jnp.any(x.diffuse != 0, 0))
    log_unit = jnp.where(fixed, 0.0, x.log_unit)
    found = DiffuseGaussian(left.mean[count:], triangular(left.scale[count:]), left.diffuse[count:], log_unit)
    return found, log_density + x.log_unit - log_unit


def _in_new_units(x: DiffuseGaussian) -> DiffuseGaussian:
    r"""The same Gaussian, the largest entry of each column of B being 1."""
    largest = jax.lax.stop_gradient(jnp.max(jnp.abs(x.diffuse), 0))
    unit = 1.0 / jnp.where(largest > 0, largest, 1.0)
    return x._replace(diffuse=x.diffuse * unit, log_unit=x.log_unit + jnp.sum(jnp.log(unit)))


def backward_conditional(x: DiffuseGaussian, linear: Linear) -> tuple[Array, Array]:
    """G (d, d) and root (d, d) of x | y ~ N(m + G (y - E y), root root^T), where y = next state; NaN if y leaves x diffuse."""
    count = len(linear.mean)
    joint = _joint(_in_new_units(x), linear, semidefinite_root(linear.noise))
    everything = jnp.ones(count, bool)
    left, _ = _eliminate(joint, linear.mean, everything, everything, jnp.zeros(count, x.mean.dtype))
    known = jnp.all(left.diffuse[count:] == 0)
    gain, root = left.response[count:], triangular(left.scale[count:])
    return jnp.where(known, gain, jnp.nan), jnp.where(known, root, jnp.nan)


class _Joint(NamedTuple):
    """Rows of data, then of the state: mean (n,), B (n, q), L (n, m), the norms that their rows had, and d mean / dy (n, k)."""

    mean: Array
    diffuse: Array
    scale: Array
    diffuse_norms: Array
    scale_norms: Array
    response: Array


def _joint(x: DiffuseGaussian, linear: Linear, noise: Array) -> _Joint:
    jacobian, (dimension, count) = linear.jacobian, (len(x.mean), len(linear.mean))
    weights = jnp.abs(jacobian)
    return _Joint(
        mean=jnp.concatenate([linear.mean, x.mean]),
        diffuse=jnp.vstack([jacobian @ x.diffuse, x.diffuse]),
        scale=jnp.vstack([jnp.hstack([jacobian @ x.scale, noise]), jnp.hstack([x.scale, jnp.zeros((dimension, count))])]),
        diffuse_norms=jnp.concatenate([weights @ _norms(x.diffuse), _norms(x.diffuse)]),
        scale_norms=jnp.concatenate([weights @ _norms(x.scale) + _norms(noise), _norms(x.scale)]),
        response=jnp.zeros((count + dimension, count), x.mean.dtype),
    )


def _eliminate(joint: _Joint, y: Array, seen: Array, exact: Array, size: Array) -> tuple[_Joint, Array]:
    """Take in the data entry by entry; `exact` are those without noise, `size` the numbers (k,) that residuals come from."""
    unit = np.finfo(joint.mean.dtype).eps

    def take_in(joint: _Joint, row: tuple[Array, ...]) -> tuple[_Joint, Array]:
        index, value, is_seen, is_exact, of_size = row
        of_flat, of_noise = joint.diffuse[index], joint.scale[index]
        is_diffuse = is_seen & (_norm(of_flat) > _ROUNDED * unit * joint.diffuse_norms[index])
        least = jnp.where(is_exact, _ROUNDED * unit * joint.scale_norms[index], 0.0)
        is_noisy = is_seen & ~is_diffuse & (_norm(of_noise) > least)
        turned_b, pivot_b = _reflected(joint.diffuse, of_flat, is_diffuse)
        turned_l, pivot_l = _reflected(joint.scale, of_noise, is_noisy)
        gain = jnp.where(is_diffuse, pivot_b, jnp.where(is_noisy, pivot_l, 0.0))
        residual = value - joint.mean[index]
        scale = jnp.where(is_diffuse, joint.scale - gain[:, None] * of_noise, turned_l)
        clean = is_seen & is_exact
        one = (jnp.arange(len(y)) == index).astype(gain.dtype)
        new = joint._replace(
            mean=joint.mean + gain * residual,
            diffuse=_rounded(turned_b, joint.diffuse_norms),
            scale=jnp.where(clean, _rounded(scale, joint.scale_norms), scale),
            response=joint.response + gain[:, None] * (one - joint.response[index]),
        )
        width = jnp.where(
            is_diffuse,
            _norm(jnp.where(is_diffuse, of_flat, 1.0)),
            jnp.where(is_noisy, _norm(jnp.where(is_noisy, of_noise, 1.0)), 1.0),
        )
        white = jnp.where(is_noisy, residual / width, 0.0)
        density = -0.5 * jnp.log(2 * jnp.pi) - jnp.log(width) - 0.5 * white**2
        wrong = jnp.abs(residual) > _SINGULAR * unit * (of_size + joint.scale_norms[index])
        known = jnp.where(is_seen & wrong, -jnp.inf, 0.0)
        return new, jnp.where(is_diffuse | is_noisy, density, known)

    rows = jnp.arange(len(y)), y, seen, exact, size
    left, densities = jax.lax.scan(take_in, joint, rows)
    return left, jnp.sum(densities)


def _reflected(columns: Array, row: Array, wanted: Array) -> tuple[Array, Array]:
    """Columns (n, m) turned so that the row (m,) has one entry alone, without the column of that entry; and the gain (n,).

    The gain is that column, for a unit of the row. If it is not wanted, the columns stay, and the gain is 0.
    """
    if not columns.shape[1]:
        return columns, jnp.zeros(len(columns), columns.dtype)
    safe = jnp.where(wanted, row, jnp.ones_like(row))
    pivot = jax.nn.one_hot(jnp.argmax(jnp.abs(safe)), len(row), dtype=row.dtype)
    length = jnp.where(pivot @ safe < 0, -_norm(safe), _norm(safe))
    normal = safe + length * pivot
    turned = columns - (columns @ normal)[:, None] * (2 * normal / (normal @ normal))
    gain = turned @ pivot / -length
    return jnp.where(wanted, turned * (1 - pivot), columns), jnp.where(wanted, gain, 0.0)


def _rounded(rows: Array, norms: Array) -> Array:
    """Rows (n, m) that are 0 where they are what rounding leaves of norms (n,)."""
    least = _ROUNDED * np.finfo(rows.dtype).eps * norms
    return jnp.where((_norms(rows) > least)[:, None], rows, 0.0)


def _norms(rows: Array) -> Array:
    """Norms (n,) of rows (n, m), which need no derivative."""
    fixed = jax.lax.stop_gradient(rows)
    return jnp.sqrt(jnp.sum(fixed**2, 1))


def _norm(row: Array) -> Array:
    """Norm of a row (m,), whose derivative at 0 is 0."""
    squared = jnp.sum(row**2)
    return jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)
