"""The activity-guided annealed filter (Darby, Li and Costen 2008, section 6.2) as plain NumPy loops.

Particles are (state, emission, free coordinate), all scalars; transitions are made one at a time, particle by particle.
"""

from __future__ import annotations

import numpy as np


def num_transitions(staying, temperature):
    """K of Eq. 12 by counting: the least number of transitions that leaves with so much probability."""
    if temperature == 0:
        return 0
    if staying == 1:
        return 1
    count = 1
    while 1 - staying**count < temperature - 1e-12:
        count += 1
    return count


def emitted(rng, chain, value, shrinking, temperature, own):
    """Steps 1 to 3 for one particle: its state and emission."""
    transition, means, sds = chain
    densities = np.exp(-0.5 * ((value - means) / sds) ** 2) / sds
    before = int(np.argmax(densities))
    state = before
    for _ in range(num_transitions(transition[before, before], shrinking * temperature)):
        state = rng.choice(len(means), p=transition[state])
    centre = value if own and state == before else means[state]
    return state, rng.normal(centre, np.sqrt(shrinking) * sds[state])


def exponent(values, survival):
    """beta at which 1 / sum of squared weights is so large a part of the particles."""
    low, high = -30.0, 30.0
    for _ in range(100):
        middle = (low + high) / 2
        weights = normalised(np.exp(middle) * values)
        low, high = (middle, high) if 1 / np.sum(weights**2) > survival * len(values) else (low, middle)
    return np.exp(low)


def normalised(log_weights):
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def filter_frame(rng, chain, walk_sd, log_likelihood, particles, weights, *, num_layers, survival, temperature):
    """One frame: particles (N, 3) of the last layer and their weights (N,)."""
    count = len(particles)
    for layer in range(num_layers):
        shrinking, new = survival**layer, []
        for _ in range(count):
            _, value, place = particles[rng.choice(count, p=weights)]
            state, value = emitted(rng, chain, value, shrinking, temperature, layer > 0)
            new.append((state, value, rng.normal(place, np.sqrt(shrinking) * walk_sd)))
        particles = np.array(new)
        values = np.array([log_likelihood(value, place) for _, value, place in particles])
        weights = normalised(exponent(values, survival) * values)
    return particles, weights
