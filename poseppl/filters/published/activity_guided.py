r"""The activity-guided annealed filter (Darby, Li and Costen 2008, doi:10.1109/AFGR.2008.4813348, section 6.2).

The annealed filter (:mod:`poseppl.filters.published.annealed`) of a model with a hidden Markov chain: a finite site s and the
site f that it emits, f ~ N(mu_s, Sigma_s), beside free ones. In each layer r = R, ..., 1 of a frame a particle's f is emitted
again:

1. the state s_i most likely to have emitted the particle's f is found, i = argmax_i N(f; mu_i, Sigma_i);
2. the chain makes K_i transitions from s_i to s_j (Eq. 12), which leave s_i with a probability of rho_r at least,

       K_i = ceil(log(1 - rho_r) / log A_ii),      rho_r = tau^(R - r) rho_T (Eq. 11);

3. f ~ N(mu_j, tau^(R - r) Sigma_j) (Eq. 10), but after the first layer around the particle's own f where s_j = s_i.

Free coordinates walk by the transition in the first layer, by tau^(R - r) P in later ones, as in the annealed filter. The site
s of a particle is s_j.

At the edges of Eq. 12: rho_T = 0 asks for K = 0, and no transition is made, so that a particle's state is the one likeliest to
have emitted its f; any rho_T up to 1 - max A_ii gives one transition, the chain's own. A_ii = 0 gives K = 1, which leaves s_i
surely. A_ii = 1 cannot be left, however large K, and K is 1. K is at most 16,383. Transitions are powers of A, so that a large
K costs no more.

Impossible states, such as limbs that intersect or angles beyond limits, have no weight. Without a chain in
the model this is the annealed filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.stats import multivariate_normal

from poseppl.checks import check_fraction
from poseppl.filters.base import Filter
from poseppl.filters.published.annealed import Disperse, Keys, annealing_filter, annealing_of, predict_by_transition
from poseppl.particles.resampling import Scheme
from poseppl.program import CompiledModel
from poseppl.program.hidden_chain import ChainSites, HiddenChain, chain_sites, hidden_chain
from poseppl.program.memoized_builder import memoized_builder

_BITS = 14
_ROUNDING = 1e-5


@memoized_builder
def activity_guided_filter(
    model: CompiledModel,
    num_particles: int = 40,
    *,
    num_layers: int = 5,
    survival: float = 0.5,
    temperature: float = 0.6,
    diffusion: Array | None = None,
    crossover: Sequence[Sequence[int | str]] | None = None,
    resampling: Scheme = "multinomial",
) -> Filter:
    """The annealed filter guided by a hidden Markov chain: it seeks a mode of the likelihood among what the chain emits.

    Args:
        model: The compiled model, with one finite site that decides one other site.
        num_particles: N in each layer, at least 1.
        num_layers: R, at least 1.
        survival: tau, the fraction of particles that survives a layer, between 0 and 1.
        temperature: rho_T, the least probability of leaving a state, from 0 to below 1.
        diffusion: Diagonal of P (d,), variances of the free coordinates; the others' are not read. By default the transition's.
        crossover: Groups of coordinates, by index or name, that stay together when two parents are crossed.
        resampling: How ancestors are drawn.

    Returns:
        The filter; its state is :class:`~poseppl.filters.published.annealed.AnnealedState`. `FilterInfo.ess` is that of the
        last layer.

    Raises:
        ValueError: A number out of its range, an unknown coordinate, or one in two groups.
        UnsuitableModelError: The model's finite sites are no chain that emits one other site.
    """
    check_fraction("[0, 1)", temperature=temperature)
    settings = annealing_of(model, num_particles, num_layers, survival, diffusion, crossover, resampling)

    by_transition = predict_by_transition(model, num_particles, diffusion)

    def predict(rng_keys: Keys, previous: Array | None, inputs: Any) -> tuple[Array, Disperse]:
        drawn, disperse_all = by_transition(rng_keys, previous, inputs)
        sites = chain_sites(model, inputs)
        chain = None if sites is None else hidden_chain(model, sites, drawn[0], inputs)

        def disperse(rng_key: Array, centres: Array, shrinking: Array) -> Array:
            particles = disperse_all(rng_key, centres, shrinking)
            if sites is None or chain is None:
                return particles
            key_emission = jax.random.fold_in(rng_key, 1)
            emitted = emit(key_emission, chain, _emissions(sites, centres), shrinking, temperature, own=True)
            return _with_emissions(sites, particles, *emitted)

        if sites is not None and chain is not None and previous is not None:
            key = jax.random.fold_in(rng_keys[0], 1)
            emitted = emit(key, chain, _emissions(sites, previous), jnp.ones(()), temperature, own=False)
            drawn = _with_emissions(sites, drawn, *emitted)
        return drawn, disperse

    return annealing_filter(model, num_particles, settings, predict)


def emit(
    rng_key: Array, chain: HiddenChain, emissions: Array, shrinking: Array, temperature: float, *, own: bool
) -> tuple[Array, Array]:
    """Steps 1 to 3 of a layer.

    Args:
        rng_key: PRNG key.
        chain: The chain of K states.
        emissions: The particles' f (N, e).
        shrinking: tau^(R - r).
        temperature: rho_T.
        own: Whether emissions of particles that stay in their state are around their own f, as after the first layer.

    Returns:
        States (N,) and emissions (N, e).
    """
    key_state, key_noise = jax.random.split(rng_key)
    log_density = jax.vmap(multivariate_normal.logpdf, (None, 0, 0), 1)
    before = jnp.argmax(log_density(emissions, chain.means, chain.covariances), 1)
    moved = transition_powers(chain.transition, num_transitions(jnp.diagonal(chain.transition), shrinking * temperature))
    after = jax.random.categorical(key_state, jnp.log(moved)[before])
    centres = chain.means[after]
    if own:
        centres = jnp.where((after == before)[:, None], emissions, centres)
    noise = jax.random.normal(key_noise, emissions.shape, emissions.dtype)
    scales = jnp.sqrt(shrinking) * jnp.linalg.cholesky(chain.covariances)[after]
    return after, centres + jnp.einsum("nij,nj->ni", scales, noise)


def num_transitions(staying: Array, temperature: Array) -> Array:
    """K of Eq. 12 (K,), int32; see the module for its edges.

    Args:
        staying: A_ii of each state (K,).
        temperature: rho, from 0 to below 1.
    """
    limits: Any = np.finfo(staying.dtype)
    inside = jnp.clip(staying, limits.tiny, 1 - limits.epsneg)
    asked = jnp.ceil(jnp.log1p(-temperature) / jnp.log(inside) - _ROUNDING)
    least = jnp.where(temperature > 0, jnp.clip(asked, 1, 2**_BITS - 1), 0)
    return jnp.where((staying >= 1) & (temperature > 0), 1, least).astype(jnp.int32)


def transition_powers(transition: Array, powers: Array) -> Array:
    """Row i of the i-th power (K,) of transition probabilities (K, K), by repeated squaring."""
    rows, squared = jnp.eye(len(transition), dtype=transition.dtype), transition
    for bit in range(_BITS):
        rows = jnp.where((powers >> bit & 1)[:, None] == 1, rows @ squared, rows)
        squared = squared @ squared
        squared = squared / squared.sum(1, keepdims=True)
    return rows


def _emissions(sites: ChainSites, particles: Array) -> Array:
    return particles[:, sites.emission.offset : sites.emission.offset + sites.emission.size]


def _with_emissions(sites: ChainSites, particles: Array, states: Array, emissions: Array) -> Array:
    """Particles (N, d) with other states (N,) and emissions (N, e)."""
    with_states = particles.at[:, sites.finite.offset].set(states.astype(particles.dtype))
    start = sites.emission.offset
    return with_states.at[:, start : start + sites.emission.size].set(emissions)
