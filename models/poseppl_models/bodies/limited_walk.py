"""A body's random walk within joint limits and about an equilibrium: what a pose's priors are in a state-space model.

Joint limits are the supports of the sites, a normal step being cut off at them. Gaussian stabilisers N(mu, S^2) (Sminchisescu
and Triggs 2001, section 3.2) are the walk's stationary distribution: with a step of standard deviation s to this frame,

    x_t ~ N(mu + a (x_(t-1) - mu), S^2 (1 - a^2)),   a^2 = max(0, 1 - s^2 / S^2),

a walk of step s while S is large, and N(mu, S^2) itself where a step is as large as S. As a factor of every frame a stabiliser
would be the stronger the more frames a second has. The first state has the product of its own Gaussian and the stabiliser.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from poseppl_models.bodies.limited_normal import LimitedNormal
from poseppl_models.bodies.random_walk import Programs


def limited_walk(spans: Mapping[str, slice], limits: Any, stabilisers: Any, equilibrium: Any = 0.0) -> Programs:
    """Write the initial and the transition program of the sites.

    Args:
        spans: The sites and their coordinates. Inputs have ``start``, ``start_scale`` and ``step_scale``, each (d,), as in
            :func:`poseppl_models.bodies.random_walk.random_walk`.
        limits: Least and largest value of each coordinate (d, 2), infinite where nothing limits it; a site without a limit is a
            plain Normal.
        stabilisers: S (d,), infinite where a coordinate has no stabiliser.
        equilibrium: mu, a number or (d,).
    """
    low, high = np.asarray(limits, float).T
    spread = np.asarray(stabilisers, float)
    rest = np.broadcast_to(np.asarray(equilibrium, float), spread.shape)

    def sample(name: str, loc: Any, scale: Any) -> None:
        span = spans[name]
        free = np.isinf(low[span]).all() and np.isinf(high[span]).all()
        limited = LimitedNormal(loc, scale, low[span], high[span], validate_args=False)
        numpyro.sample(name, dist.Normal(loc, scale, validate_args=False) if free else limited)

    def initial(params: Any, inputs: Any) -> None:
        for name, span in spans.items():
            start, scale = inputs.start[span], inputs.start_scale[span]
            ratio = (scale / spread[span]) ** 2
            sample(name, start + ratio / (1 + ratio) * (rest[span] - start), scale / jnp.sqrt(1 + ratio))

    def transition(params: Any, state: Mapping[str, Any], inputs: Any) -> None:
        for name, span in spans.items():
            step = inputs.step_scale[span]
            kept = jnp.sqrt(jnp.maximum(1 - (step / spread[span]) ** 2, 0.0))
            sample(name, rest[span] + kept * (state[name] - rest[span]), jnp.minimum(step, spread[span]))

    return initial, transition
