r"""The particle filter with the temporal prior as proposal (Gordon, Salmond and Smith 1993, doi:10.1049/ip-f-2.1993.0015).

Section 3 of Choo and Fleet 2001 (doi:10.1109/ICCV.2001.937643): :mod:`poseppl.filters.sequential_monte_carlo` with
q = p(x_t | x_(t-1)), so that w_i is proportional to its old weight times p(z_t | x_i).
"""

from __future__ import annotations

from typing import Any

from jax import Array

from poseppl.filters.adaptive_resampling import adaptive_resampling
from poseppl.filters.base import Filter
from poseppl.filters.sequential_monte_carlo import Lookahead, smc_filter
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import Scheme
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, propagate


@memoized_builder
def particle_filter(
    model: CompiledModel, num_particles: int = 10_000, *, resampling: Scheme = "systematic", ess_threshold: float = 1.0
) -> Filter:
    """The particle filter with the temporal prior as proposal.

    Args:
        model: The compiled model.
        num_particles: N, at least 1.
        resampling: How ancestors are drawn.
        ess_threshold: Resample when ESS <= threshold * N: 1 at every frame, 0 never.

    Returns:
        The filter; its state is :class:`~poseppl.filters.sequential_monte_carlo.ParticleState`.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
    """

    def propose(previous: Array | None, observation: Observation, inputs: Any) -> Lookahead:
        def draw(rng_key: Array, ancestors: Array) -> tuple[Array, None]:
            keys = particle_keys(rng_key, num_particles)
            if previous is None:
                return draw_initial(model, keys, inputs), None
            return propagate(model, keys, previous[ancestors], inputs), None

        return Lookahead(draw)

    return smc_filter(model, propose, adaptive_resampling(num_particles, resampling, ess_threshold))
