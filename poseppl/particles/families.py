r"""How many independent draws a sample is worth that descends from few: Kish's design effect, by an analysis of variance.

Resampled particles are copies, which moves have to draw apart. Particles that descend from one draw are a family; where moves
have forgotten it, members are as different as any two particles, and families have alike means. With masses w_a of the F
families, of N equally weighted particles, and a total variance of 1, of which the families' means have the share b,

    E[1 - b] = s^2 (1 - F / N),        E[b] = s_f^2 (1 - sum w_a^2) + s^2 (F - 1) / N

give the variances s^2 within families and s_f^2 between them (Searle, Casella and McCulloch 1992, chapter 4, of one random
factor), and the sample's mean errs by s_f^2 sum w_a^2 + s^2 / N times the sample's own variance: the effective number is its
inverse (Kish 1965, section 5.4). It is N of particles that have forgotten their ancestors, and 1 / sum w_a^2 - 1 of copies.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def clustered_ess(particles: Array, families: Array) -> Array:
    """Effective number of equally weighted particles, between 1 and N, on average over their coordinates.

    Args:
        particles: (N, d).
        families: The family of each (N,), from 0 to N - 1. The likeness within a single family is unknown: it counts as 1.

    Example:
        >>> alike = jnp.array([[0.0], [0.0], [1.0], [1.0], [2.0], [2.0], [3.0], [3.0]])
        >>> round(float(clustered_ess(alike, jnp.array([0, 0, 1, 1, 2, 2, 3, 3]))), 3)
        3.0
    """
    count = particles.shape[0]
    mass = jnp.zeros(count, particles.dtype).at[families].add(1 / count)
    number, squares = jnp.sum(mass > 0), jnp.sum(mass**2)
    spread = jnp.std(particles, 0)
    white = (particles - jnp.mean(particles, 0)) / jnp.where(spread > 0, spread, 1.0)
    centres = jnp.zeros_like(white).at[families].add(white / count) / jnp.maximum(mass, 1 / count)[:, None]
    between = jnp.sum(mass @ centres**2) / jnp.maximum(jnp.sum(spread > 0), 1)
    within = (1 - between) / jnp.maximum(1 - number / count, 1 / count)
    alike = jnp.maximum(between - within * (number - 1) / count, 0.0) / jnp.maximum(1 - squares, 1 / count)
    return jnp.where(number == 1, 1.0, 1 / jnp.clip(alike * squares + within / count, 1 / count, 1.0))
