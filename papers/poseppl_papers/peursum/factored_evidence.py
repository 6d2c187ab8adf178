r"""Inputs of smoothers of the FS-HHMM (sections 4.3 and 4.4.1): the mixture in place of the likelihood, and logarithms.

The filter draws new particles at every frame, so that their weights are their likelihoods. Particles of at least average weight
are the components' first means, with fixed standard deviations of 3 degrees (rotations), 20, 20 and 10 mm (position) and 5
degrees (heading); weights and means follow by expectation maximisation (Eqs. 18 to 20). Angles are compared on the circle.

Position and heading have no dynamics on the mixture, but Gaussian priors with the filter's moments (Eqs. 22e, 22f and 23).
Eq. 23b prints sum_i (w_i v_i)^2 - mu^2, which is negative; the variance sum_i w_i v_i^2 - mu^2 is meant.

A probability of 0 makes a Kullback-Leibler divergence infinite, and a Gibbs sampler stand still: tables are floored.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.gaussians.weighted_em import choose_seeds, fit_fixed
from poseppl.motion.learned import FactoredTables, bin_angles
from poseppl.motion.learned.angles import wrapped

ROTATION = float(np.radians(3.0))
ROOT = (20.0, 20.0, 10.0, float(np.radians(5.0)))
"""Standard deviations of components: radians; mm, mm, mm, radians."""
FLOOR = 1e-6
_ROUNDS = 20
_MIN_VARIANCE = 1e-6


class Mixtures(NamedTuple):
    """The likelihoods of T frames as mixtures of K components, and what is known of the root besides.

    Attributes:
        log_weights: (T, K), -inf where there is no component.
        rotations: Means (T, K, D), radians.
        roots: Means (T, K, 4): x, y, z (mm), heading (radians, within half a turn of its prior mean).
        prior_mean: Mean of position and heading (T, 4).
        prior_variance: Likewise (T, 4).
    """

    log_weights: Array
    rotations: Array
    roots: Array
    prior_mean: Array
    prior_variance: Array

    @property
    def precision(self) -> Array:
        """Precision of position and heading given the component."""
        return 1 / self.prior_variance + 1 / jnp.square(jnp.asarray(ROOT))

    def root_mean(self, towards: Array) -> Array:
        """Mean of position and heading given the (mean) component's."""
        pulls = self.prior_mean / self.prior_variance + towards / jnp.square(jnp.asarray(ROOT))
        return pulls / self.precision


class LogTables(NamedTuple):
    """Logarithms of floored tables, ends of rotations resolved (Eq. 26).

    Attributes:
        first_phase: (M,).
        first_bins: (M, D, B).
        phases: (M, M).
        steps: (M, D, B, B).
    """

    first_phase: Array
    first_bins: Array
    phases: Array
    steps: Array


class FactoredPosterior(NamedTuple):
    """Marginals of T frames.

    Attributes:
        phases: Probabilities (T, M).
        bins: Probabilities (T, D, B).
        root_mean: Mean of position and heading (T, 4), mm and radians.
        root_variance: Likewise (T, 4).
    """

    phases: Array
    bins: Array
    root_mean: Array
    root_variance: Array

    def mean_rotations(self) -> Array:
        """Directions of the mean of unit vectors (T, D), radians."""
        angles = bin_angles(jnp.arange(self.bins.shape[-1]), self.bins.shape[-1])
        return jnp.arctan2(self.bins @ jnp.sin(angles), self.bins @ jnp.cos(angles))


def log_tables(tables: FactoredTables, floor: float = FLOOR) -> LogTables:
    """Resolve ends, and give a share `floor` of each row to all of its entries alike."""
    ends = jnp.sum(tables.steps, -1, keepdims=True) <= 0
    steps = jnp.where(ends, tables.entries[:, :, None, :], tables.steps)
    rows = tables.first_phase, tables.first_bins, tables.phases, steps
    return LogTables(*(jnp.log((1 - floor) * row + floor / row.shape[-1]) for row in rows))


def fit_mixtures(rng_key: Array, rotations: Array, roots: Array, log_weights: Array, max_components: int = 300) -> Mixtures:
    """Replace the likelihoods by mixtures.

    Args:
        rng_key: For the choice among more components than there may be.
        rotations: Rotations of the particles (T, N, D), radians.
        roots: Likewise (T, N, 4): x, y, z, heading.
        log_weights: Normalised (T, N).
        max_components: K; published are as many as there are particles of average weight and more.
    """
    keys = jax.random.split(rng_key, rotations.shape[0])
    scales = jnp.concatenate([jnp.full(rotations.shape[-1], ROTATION), jnp.asarray(ROOT)])

    def fit(row: tuple[Array, Array, Array, Array]) -> Mixtures:
        key, rotation, root, log_weight = row
        weights = jnp.exp(log_weight)
        direction = jnp.arctan2(weights @ jnp.sin(root[:, 3]), weights @ jnp.cos(root[:, 3]))
        root = root.at[:, 3].set(direction + wrapped(root[:, 3] - direction))
        mean = weights @ root
        variance = jnp.maximum(weights @ jnp.square(root - mean), _MIN_VARIANCE)
        middle = jnp.arctan2(weights @ jnp.sin(rotation), weights @ jnp.cos(rotation))
        points = jnp.concatenate([wrapped(rotation - middle), root - mean], axis=1)
        seeds, alive = choose_seeds(key, log_weight, max_components)
        fitted = fit_fixed(points, weights, seeds, alive, scales, _ROUNDS)
        turns = rotation.shape[1]
        return Mixtures(fitted.log_weights, fitted.means[:, :turns] + middle, fitted.means[:, turns:] + mean, mean, variance)

    found: Mixtures = jax.lax.map(fit, (keys, rotations, roots, log_weights))
    return found


def bin_log_likelihoods(rotations: Array, num_bins: int) -> Array:
    """Log N(bin; mean, 3 degrees) up to a constant (K, D, B), of a frame's means (K, D)."""
    apart = wrapped(bin_angles(jnp.arange(num_bins), num_bins) - rotations[..., None])
    return -0.5 * jnp.square(apart / ROTATION)


def diffusion_tables(scales: Array, num_bins: int) -> FactoredTables:
    """The generic motion as tables of one phase: a Gaussian step, standard deviations (D,) radians, on the circle."""
    angles = bin_angles(jnp.arange(num_bins), num_bins)
    apart = wrapped(angles[None, :] - angles[:, None])
    rows = jax.nn.softmax(-0.5 * jnp.square(apart / scales[:, None, None]), axis=-1)[None]
    flat = jnp.full((1, len(scales), num_bins), 1 / num_bins)
    one = jnp.ones((1, 1))
    return FactoredTables(one[0], flat, one, flat, rows, jnp.zeros((1, 3)))
