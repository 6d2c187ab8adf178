"""Laws on what smoothers find, where the smoothing distributions are known exactly.

Tolerances are 5 standard errors over independent replicates of filter and smoother; mistakes that are wrapped around every
smoother show that the laws would notice.
"""

from __future__ import annotations

from typing import NamedTuple

import pytest
from catalogue import SMOOTHERS, rows
from mistakes import SHARED_MISTAKES, Mistakes
from smoothing_problems import (
    broken_laws,
    growth_problem,
    linear_problem_of_dimension,
    linear_problem_with_powers,
    markov_problem,
    replicator,
)

from poseppl.smoothers import MixtureSettings, mixture_variational_smoother

ROWS = {row.name: row for row in SMOOTHERS}
FRAMES_OF_ONE_COMPONENT = ROWS["mixture-variational-frames"]._replace(
    name="mixture-variational-frames-of-one-component",
    build=lambda model: mixture_variational_smoother(
        model, num_components=1, num_rounds=30, factorised=True, mixture=MixtureSettings(covariance="free", num_steps=2)
    ),
    num_particles=1000,
    moments=("means",),
)
LINEAR = [*(row for row in SMOOTHERS if row.moments), FRAMES_OF_ONE_COMPONENT]
CHEAP = (
    "backward-simulation-metropolis",
    "two-filter-linear",
    "genealogy",
    "fixed-lag",
    "rauch-tung-striebel",
    "ensemble-kalman",
    "mixture-variational",
)
"""Smoothers that make their replicates in a tenth of a second."""
LARGE = (
    "particle-mgrad",
    "particle-gibbs-ancestor",
    "trajectory-nuts",
    "two-filter",
    "two-filter-linear",
    "mixture-variational",
)
consistent_smoothers = rows([r for r in SMOOTHERS if r.consistent], default=lambda row: row.name not in LARGE)
discrete_smoothers = rows([r for r in SMOOTHERS if r.consistent and r.discrete])
two_kinds = pytest.mark.parametrize("name", ["forward-backward", "backward-simulation"])


def linear_smoothers(quick):
    """All that know something of a linear Gaussian model."""
    return rows(LINEAR, quick, default=lambda row: row.name not in LARGE)


def check_exact(row, *posed_by):
    posed, replicate = replicator(row, *posed_by)
    assert not broken_laws(row, posed, replicate())


@linear_smoothers(lambda row: row.consistent and not row.variant or row.name in CHEAP)
def test_means_and_covariances_are_those_of_rauch_tung_and_striebel(row):
    """Also at a frame without data, whose smoothing distribution comes from both sides."""
    check_exact(row, linear_problem_with_powers, row.lag)


@pytest.mark.full
@discrete_smoothers
@pytest.mark.parametrize("num_states", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_states_of_a_hidden_markov_chain_have_their_probabilities(row, num_states):
    check_exact(row, markov_problem, num_states)


@pytest.mark.full
@rows([row for row in SMOOTHERS if row.consistent and row.multimodal], lambda row: row.name in CHEAP)
def test_growth_model_has_the_moments_of_quadrature(row):
    """Two modes, a transition that bends, and time as an input."""
    check_exact(row, growth_problem)


@pytest.mark.full
@two_kinds
@pytest.mark.parametrize("dimension", [1, *(pytest.param(many, marks=pytest.mark.slow) for many in (10, 28))])
def test_linear_models_of_other_dimensions(name, dimension):
    check_exact(ROWS[name], linear_problem_of_dimension, dimension)


MISTAKES = SHARED_MISTAKES | {
    "data of the frame before": Mistakes(late_data=1),
    "future ignored": Mistakes(filtered=1),
    "transitions twice": Mistakes(transition=1.0),
    "no transitions": Mistakes(transition=-0.9999),
    "last data twice": Mistakes(last=1.0),
    "neighbours mixed up": Mistakes(shuffled=1),
}
CHAINS = (
    "particle-gibbs-ancestor",
    "particle-gibbs-backward",
    "particle-mgrad",
    "particle-agrad",
    "trajectory-nuts",
    "trajectory-hmc",
    "gibbs-model",
)
REWEIGHED = ("forward-backward", "backward-simulation", "backward-simulation-metropolis")
ANCESTRAL = ("genealogy", "fixed-lag")
OF_THEIR_OWN = ("rauch-tung-striebel", "ensemble-kalman", "ensemble-kalman-stochastic")
TWO_FILTER = ("two-filter", "two-filter-linear")
FITTED = ("variational", "variational-pathfinder", "variational-mean-field")


class Excuse(NamedTuple):
    """Mistakes that change nothing of what some smoothers tell, and why."""

    mistakes: tuple[str, ...]
    smoothers: tuple[str, ...]
    reason: str


EXCUSES = [
    Excuse(("weights ignored",), CHAINS, "chains start at the filter's particles, and forget them"),
    Excuse(("weights ignored",), ("viterbi",), "the best path looks at the particles' places alone"),
    Excuse(("weights ignored",), ("laplace", *FITTED), "it climbs from the filter's mean to the one mode, wherever that is"),
    Excuse(("weights ignored",), OF_THEIR_OWN, "they make a Kalman filter of their own"),
    Excuse(
        ("inputs of the frame before", "initial density twice", "transitions twice", "no transitions"),
        ANCESTRAL,
        "ancestors tell all: the model is not asked",
    ),
    Excuse(
        ("initial density twice",),
        (*REWEIGHED, *TWO_FILTER, "assumed-density"),
        "the filter's weights have it, and it is not asked again",
    ),
    Excuse(
        ("initial density twice",),
        ("gibbs", "mixture-variational", FRAMES_OF_ONE_COMPONENT.name),
        "their mixture of the first likelihood divides by it",
    ),
    Excuse(("one key for all",), (*REWEIGHED, *ANCESTRAL, "viterbi"), "what a run draws is little beside what its filter drew"),
    Excuse(
        ("neighbours mixed up",),
        ("forward-backward", *TWO_FILTER, "fixed-lag", "variational-mean-field", FRAMES_OF_ONE_COMPONENT.name),
        "it tells each frame's distribution alone",
    ),
    Excuse(("neighbours mixed up",), ("viterbi",), "it tells one trajectory"),
]
UNDECIDED = [("particle-mgrad", "one key for all"), ("particle-agrad", "one key for all")]
"""The filter's particles scale the steps of a run, so equal keys make unequal draws: some machines notice this, some do not."""


def excused(row, mistake):
    return any(mistake in excuse.mistakes and row.name in excuse.smoothers for excuse in EXCUSES)


@pytest.mark.full
@linear_smoothers(lambda row: row.name in CHEAP)
def test_mistakes_are_noticed(row):
    """Each by a law that the right smoother holds, but those that change nothing for a smoother of its kind."""
    posed, replicate = replicator(row, linear_problem_with_powers, row.lag)
    assert not broken_laws(row, posed, replicate())
    for name, mistakes in MISTAKES.items():
        if (row.name, name) in UNDECIDED:
            continue
        assert bool(broken_laws(row, posed, replicate(mistakes))) != excused(row, name), name
