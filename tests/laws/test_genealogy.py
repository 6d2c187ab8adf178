"""Laws on ancestors, and on frames that make every filter resample: a state is where its ancestor leads to."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import FILTERS, is_cheap, rows
from law_problems import run
from oracles.kalman import simulate
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

RESAMPLED_OTHERWISE = ("particle-adaptive", "tempered-fixed")
"""Variants whose ancestors come another way."""
genealogical_filters = rows([r for r in FILTERS if r.genealogy], lambda row: is_cheap(row) or row.name in RESAMPLED_OTHERWISE)
SPREAD = 0.01
"""Standard deviation of the transition, a hundredth of the first state's."""


def drifting():
    """A first frame without data, then precise ones, of states that hardly leave their path."""
    matrices = linear_gaussian_matrices(2, A=[[0.9, 0.2], [-0.1, 0.8]], Q=SPREAD**2 * np.eye(2), R=0.04 * np.eye(2))
    _, ys = simulate(matrices, 4, seed=2)
    ys[0] = np.nan
    model = linear_gaussian_model(matrices).compile()
    return matrices, model, model.observe({"y": ys})


def distances(row, shift=0):
    """Distances (3, N) of the particles of frames 1 to 3 from where their ancestors lead to, and the infos (4, ...)."""
    matrices, model, observations = drifting()
    built = row.build(model)
    states, infos = jax.jit(lambda key: run(built, key, observations, jnp.zeros(4)))(jax.random.key(0))
    particles, ancestors = np.asarray(states.particles), np.asarray(infos.ancestors)
    previous = np.take_along_axis(particles[:-1], np.roll(ancestors[1:], shift, 1)[..., None], 1)
    return np.linalg.norm(particles[1:] - previous @ matrices.A.T, axis=-1), infos


@genealogical_filters
def test_a_state_is_where_its_ancestor_leads_to(row):
    found, infos = distances(row)
    # each of some thousand distances is Rayleigh's: beyond six spreads once in 10^8
    assert found.max() < 6 * SPREAD
    fewest = min(len(np.unique(ancestors)) for ancestors in infos.ancestors[1:])
    assert fewest < 0.8 * infos.ancestors.shape[1], "the law says nothing of a filter that does not resample"
    if row.name in ("tempered", "tempered-waste-free"):  # the frame without data takes one temperature
        assert infos.num_likelihood[1] >= 2 * infos.num_likelihood[0], "nor of one that does not temper"


@pytest.mark.full
def test_ancestors_of_a_neighbour_are_noticed():
    found, _ = distances(next(row for row in FILTERS if row.name == "particle"), shift=1)
    assert found.max() > 20 * SPREAD
