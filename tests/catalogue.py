"""Every algorithm, one row each: the row buys the laws in tests/laws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import pytest

from poseppl.filters import (
    Filter,
    activity_guided_filter,
    annealed_filter,
    assumed_density_filter,
    covariance_scaled_filter,
    demc_filter,
    ensemble_kalman_filter,
    guided_filter,
    hmc_filter,
    kalman_filter,
    particle_filter,
    rao_blackwellised_filter,
    switching_filter,
    tempered_filter,
    window_filter,
)
from poseppl.kernels import RANDOM_WALK_MOVES, HMCSettings, MoveSettings
from poseppl.program import CompiledModel
from poseppl.smoothers import (
    MixtureSettings,
    Smoother,
    assumed_density_smoother,
    backward_simulation_smoother,
    ensemble_kalman_smoother,
    fixed_lag_smoother,
    forward_backward_smoother,
    genealogy_smoother,
    gibbs_smoother,
    laplace_smoother,
    mixture_variational_smoother,
    particle_gibbs_smoother,
    particle_mgrad_smoother,
    rauch_tung_striebel_smoother,
    trajectory_smoother,
    two_filter_smoother,
    variational_smoother,
    viterbi_smoother,
)


class FilterRow(NamedTuple):
    """One filter.

    Attributes:
        name: Identifies the row in test reports.
        function: The public builder.
        build: A small instance for a model.
        unbiased_evidence: Whether exp(log_evidence) is an unbiased estimate of the evidence.
        consistent: Whether means and variances converge to the exact ones at every frame, with more particles or draws.
        num_replicates: Independent runs that the statistical laws make, at least 40.
        posterior: Whether it samples the posterior at all; False exempts a seeker of modes from the laws on moments.
        evidence_error: Relative error of a frame's evidence that comes from its approximation, at most.
        genealogy: Whether a particle descends from the ancestor that FilterInfo names, by the transition.
        equal_weights: Whether all particles of a frame weigh the same.
        variant: Whether it is a second setting of a filter that has a row: its laws are slow tests.
        costly: Whether it compiles long: its laws are slow tests, but for those of the posterior.
    """

    name: str
    function: Callable[..., Filter]
    build: Callable[[CompiledModel], Filter]
    unbiased_evidence: bool = False
    consistent: bool = True
    num_replicates: int = 200
    posterior: bool = True
    evidence_error: float = 1e-4
    genealogy: bool = False
    equal_weights: bool = False
    variant: bool = False
    costly: bool = False


FILTERS: list[FilterRow] = [
    FilterRow("particle", particle_filter, lambda model: particle_filter(model, 2000), unbiased_evidence=True, genealogy=True),
    FilterRow(
        "particle-adaptive",
        particle_filter,
        lambda model: particle_filter(model, 1000, resampling="stratified", ess_threshold=0.5),
        unbiased_evidence=True,
        genealogy=True,
        variant=True,
    ),
    FilterRow(
        "particle-residual",
        particle_filter,
        lambda model: particle_filter(model, 1000, resampling="residual", ess_threshold=0.9),
        unbiased_evidence=True,
        genealogy=True,
        variant=True,
    ),
    FilterRow(
        "particle-multinomial",
        particle_filter,
        lambda model: particle_filter(model, 1000, resampling="multinomial"),
        unbiased_evidence=True,
        genealogy=True,
        variant=True,
    ),
    FilterRow("guided", guided_filter, lambda model: guided_filter(model, 500), unbiased_evidence=True, genealogy=True),
    FilterRow(
        "auxiliary",
        guided_filter,
        lambda model: guided_filter(model, 500, auxiliary=True, ess_threshold=0.5),
        unbiased_evidence=True,
        genealogy=True,
        variant=True,
    ),
    FilterRow("kalman", kalman_filter, lambda model: kalman_filter(model, 500), equal_weights=True),
    FilterRow("switching", switching_filter, lambda model: switching_filter(model, 500), equal_weights=True),
    FilterRow(
        "unscented",
        kalman_filter,
        lambda model: kalman_filter(model, 500, linearisation="unscented"),
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "iterated",
        kalman_filter,
        lambda model: kalman_filter(model, 500, num_iterations=2),
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "gauss-hermite",
        kalman_filter,
        lambda model: kalman_filter(model, 500, linearisation="gauss-hermite"),
        equal_weights=True,
        variant=True,
    ),
    # without finite sites, as in the laws' model, all its particles are one Kalman filter
    FilterRow(
        "rao-blackwellised",
        rao_blackwellised_filter,
        lambda model: rao_blackwellised_filter(model, 500),
        equal_weights=True,
        variant=True,
    ),
    FilterRow("ensemble-kalman", ensemble_kalman_filter, lambda model: ensemble_kalman_filter(model, 1000), equal_weights=True),
    FilterRow(
        "ensemble-kalman-stochastic",
        ensemble_kalman_filter,
        lambda model: ensemble_kalman_filter(model, 1000, form="stochastic"),
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "hmc",
        hmc_filter,
        lambda model: hmc_filter(model, 20, HMCSettings(num_updates=40, num_leapfrog=8, num_warmup=10)),
        consistent=False,
        equal_weights=True,
    ),
    FilterRow(
        "hmc-dense",
        hmc_filter,
        lambda model: hmc_filter(
            model,
            20,
            HMCSettings(num_updates=40, num_leapfrog=8, num_warmup=10, target_acceptance=None, jitter=0.5),
            dense_mass=True,
        ),
        consistent=False,
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "assumed-density",
        assumed_density_filter,
        lambda model: assumed_density_filter(model, 60, num_starts=4, num_components=1),
        equal_weights=True,
    ),
    FilterRow(
        "assumed-density-default",
        assumed_density_filter,
        assumed_density_filter,
        num_replicates=40,
        evidence_error=0.06,  # Laplace's approximation of three Gaussians that overlap
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "window",
        window_filter,
        lambda model: window_filter(model, 60, num_starts=4),
        num_replicates=40,
        equal_weights=True,
        costly=True,
    ),
    FilterRow(
        "tempered",
        tempered_filter,
        lambda model: tempered_filter(model, 300),
        num_replicates=40,
        genealogy=True,
        equal_weights=True,
        costly=True,
    ),
    FilterRow(
        "tempered-fixed",
        tempered_filter,
        lambda model: tempered_filter(
            model,
            100,
            target="mixture",
            moves=MoveSettings(num_moves=1, target_acceptance=None),
            temperatures=(0.2, 1.0),
            whiten=False,
        ),
        unbiased_evidence=True,
        genealogy=True,
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "tempered-waste-free",
        tempered_filter,
        lambda model: tempered_filter(model, 600, moves=RANDOM_WALK_MOVES, chain_length=10, resampling="stratified"),
        num_replicates=40,
        genealogy=True,
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "covariance-scaled",
        covariance_scaled_filter,
        lambda model: covariance_scaled_filter(model, 500, num_modes=3, num_starts=10, num_directions=2),
        equal_weights=True,
        costly=True,
    ),
    FilterRow(
        "multiple-hypothesis",
        covariance_scaled_filter,
        lambda model: covariance_scaled_filter(model, 500, num_modes=2, num_starts=4, sampling="hypotheses", prior="mixture"),
        num_replicates=40,
        equal_weights=True,
        variant=True,
    ),
    FilterRow(
        "annealed",
        annealed_filter,
        lambda model: annealed_filter(model, 200, num_layers=5, crossover=[[0], [1]]),
        consistent=False,
        num_replicates=40,
        posterior=False,
        costly=True,
    ),
    FilterRow(
        "activity-guided",
        activity_guided_filter,
        lambda model: activity_guided_filter(model, 200, num_layers=5),
        consistent=False,
        num_replicates=40,
        posterior=False,
        costly=True,
    ),
    FilterRow(
        "demc",
        demc_filter,
        lambda model: demc_filter(model, 200, num_layers=3, prediction="velocity"),
        consistent=False,
        num_replicates=40,
        posterior=False,
        costly=True,
    ),
    FilterRow(
        "demc-posterior",
        demc_filter,
        lambda model: demc_filter(model, 300, target="posterior", num_layers=5, snooker=0.1),
        num_replicates=40,
        equal_weights=True,
        variant=True,
    ),
]


MOMENTS = ("means", "covariances", "neighbours")
"""Moments of the smoothing distribution; the last are of each frame's state with the next one's."""


class SmootherRow(NamedTuple):
    """One smoother.

    Attributes:
        name: Identifies the row in test reports.
        function: The public builder.
        build: A small instance for a model.
        consistent: Whether means and variances converge to the exact ones, with more particles or draws.
        discrete: Whether it also takes models of finite states.
        draws: Whether another key makes other draws; else it uses none.
        multimodal: Whether it weighs every mode that the filter found, however far apart.
        num_replicates: Independent runs (of filter and smoother) that the statistical laws make.
        num_particles: Number of particles of the particle filter whose history it takes.
        lag: Later frames whose data a frame knows; None knows all. Given those, it is consistent.
        moments: Those that are exact on a linear Gaussian model, with more particles or draws.
        variant: Whether it is a second setting of a smoother that has a row: its laws are slow tests.
        costly: Whether it compiles long: its laws are slow tests, but for those of the posterior.
    """

    name: str
    function: Callable[..., Smoother]
    build: Callable[[CompiledModel], Smoother]
    consistent: bool = True
    discrete: bool = False
    draws: bool = True
    multimodal: bool = True
    num_replicates: int = 40
    num_particles: int = 500
    lag: int | None = None
    moments: tuple[str, ...] = MOMENTS
    variant: bool = False
    costly: bool = False


SMOOTHERS: list[SmootherRow] = [
    SmootherRow(
        "particle-gibbs-ancestor",
        particle_gibbs_smoother,
        lambda model: particle_gibbs_smoother(model, num_particles=20, num_chains=2, num_draws=100, num_warmup=20),
        discrete=True,
        num_particles=100,
        costly=True,
    ),
    SmootherRow(
        "particle-gibbs-backward",
        particle_gibbs_smoother,
        lambda model: particle_gibbs_smoother(
            model, num_particles=20, num_chains=2, num_draws=100, num_warmup=20, method="backward"
        ),
        discrete=True,
        num_particles=100,
        variant=True,
    ),
    SmootherRow(
        "particle-mgrad",
        particle_mgrad_smoother,
        lambda model: particle_mgrad_smoother(
            model, num_particles=16, num_chains=2, num_draws=100, num_warmup=50, variant="mgrad"
        ),
        multimodal=False,
        num_particles=100,
        costly=True,
    ),
    SmootherRow(
        "particle-agrad",
        particle_mgrad_smoother,
        lambda model: particle_mgrad_smoother(
            model, num_particles=16, num_chains=2, num_draws=100, num_warmup=50, variant="agrad"
        ),
        multimodal=False,
        num_particles=100,
        variant=True,
    ),
    SmootherRow(
        "forward-backward",
        forward_backward_smoother,
        lambda model: forward_backward_smoother(model, tile=128),
        discrete=True,
        draws=False,
    ),
    SmootherRow(
        "backward-simulation",
        backward_simulation_smoother,
        lambda model: backward_simulation_smoother(model, 300, tile=128),
        discrete=True,
    ),
    SmootherRow(
        "backward-simulation-metropolis",
        backward_simulation_smoother,
        lambda model: backward_simulation_smoother(model, 300, method="metropolis", num_moves=2),
        discrete=True,
        variant=True,
        costly=True,
    ),
    SmootherRow("two-filter", two_filter_smoother, lambda model: two_filter_smoother(model, tile=128)),
    SmootherRow(
        "two-filter-linear",
        two_filter_smoother,
        lambda model: two_filter_smoother(model, method="linear"),
        variant=True,
    ),
    SmootherRow(
        "viterbi", viterbi_smoother, viterbi_smoother, consistent=False, discrete=True, draws=False, moments=("means",)
    ),
    SmootherRow("genealogy", genealogy_smoother, genealogy_smoother, discrete=True, draws=False),
    SmootherRow(
        "fixed-lag",
        fixed_lag_smoother,
        lambda model: fixed_lag_smoother(model, lag=2),
        consistent=False,
        discrete=True,
        draws=False,
        lag=2,
    ),
    SmootherRow(
        "rauch-tung-striebel",
        rauch_tung_striebel_smoother,
        lambda model: rauch_tung_striebel_smoother(model, num_draws=500),
        multimodal=False,
    ),
    SmootherRow(
        "assumed-density",
        assumed_density_smoother,
        lambda model: assumed_density_smoother(model, num_draws=500),
        multimodal=False,
    ),
    SmootherRow(
        "ensemble-kalman",
        ensemble_kalman_smoother,
        lambda model: ensemble_kalman_smoother(model, num_particles=1000),
        multimodal=False,
    ),
    SmootherRow(
        "ensemble-kalman-stochastic",
        ensemble_kalman_smoother,
        lambda model: ensemble_kalman_smoother(model, num_particles=1000, lag=40, form="stochastic"),
        multimodal=False,
        variant=True,
    ),
    SmootherRow(
        "laplace", laplace_smoother, lambda model: laplace_smoother(model, num_draws=500), consistent=False, multimodal=False
    ),
    SmootherRow(
        "variational",
        variational_smoother,
        lambda model: variational_smoother(model, num_steps=50, num_samples=4),
        consistent=False,
        multimodal=False,
        costly=True,
    ),
    SmootherRow(
        "variational-pathfinder",
        variational_smoother,
        lambda model: variational_smoother(model, num_steps=50, num_samples=4, start="pathfinder"),
        consistent=False,
        multimodal=False,
        variant=True,
    ),
    SmootherRow(
        "variational-mean-field",
        variational_smoother,
        lambda model: variational_smoother(model, num_steps=50, num_samples=4, family="mean-field"),
        consistent=False,
        multimodal=False,
        moments=("means",),
        variant=True,
    ),
    SmootherRow(
        "trajectory-nuts",
        trajectory_smoother,
        lambda model: trajectory_smoother(model, num_chains=2, num_draws=100, num_warmup=50, num_curvatures=8),
        num_particles=100,
        multimodal=False,
        costly=True,
    ),
    SmootherRow(
        "trajectory-hmc",
        trajectory_smoother,
        lambda model: trajectory_smoother(
            model, num_chains=2, num_draws=100, num_warmup=50, kernel="hmc", num_leapfrog=8, num_curvatures=8
        ),
        num_particles=100,
        multimodal=False,
        variant=True,
    ),
    SmootherRow(
        "gibbs",
        gibbs_smoother,
        lambda model: gibbs_smoother(model, num_components=20, num_chains=2, num_draws=90, num_warmup=10),
        consistent=False,
        costly=True,
    ),
    SmootherRow(
        "gibbs-model",
        gibbs_smoother,
        lambda model: gibbs_smoother(
            model, num_components=20, num_chains=2, num_draws=270, num_warmup=30, target="model", collapsed=False
        ),
        variant=True,
    ),
    SmootherRow(
        "mixture-variational",
        mixture_variational_smoother,
        lambda model: mixture_variational_smoother(
            model, num_components=1, num_rounds=2, mixture=MixtureSettings(covariance="free", num_steps=2)
        ),
        num_particles=1000,
        multimodal=False,
        costly=True,
    ),
    SmootherRow(
        "mixture-variational-frames",
        mixture_variational_smoother,
        lambda model: mixture_variational_smoother(
            model, num_components=20, num_draws=200, factorised=True, mixture=MixtureSettings(correction="none")
        ),
        consistent=False,
        moments=(),  # many narrow components leave an error of 0.2 standard deviations in the means
        variant=True,
    ),
]


def is_first(row: Any) -> bool:
    """Whether it is no variant."""
    return not row.variant


def is_cheap(row: Any) -> bool:
    """Whether it is no variant and compiles soon."""
    return not (row.variant or row.costly)


def rows(
    chosen: Sequence[Any], quick: Callable[[Any], bool] = is_cheap, default: Callable[[Any], bool] = lambda row: True
) -> pytest.MarkDecorator:
    """A test for each row, marked with its tier.

    Args:
        chosen: Rows.
        quick: Which of them are not slow tests.
        default: Which of the quick tests are of the default tier; the others are full.
    """

    def marks(row: Any) -> tuple[pytest.MarkDecorator, ...]:
        if not quick(row):
            return (pytest.mark.slow,)
        return () if default(row) else (pytest.mark.full,)

    return pytest.mark.parametrize("row", [pytest.param(row, id=row.name, marks=marks(row)) for row in chosen])
