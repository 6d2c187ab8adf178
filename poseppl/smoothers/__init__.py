"""Smoothers: one algorithm a file, each a pure function from a filter's history to smoothed states."""

from poseppl.smoothers.assumed_density import assumed_density_smoother as assumed_density_smoother
from poseppl.smoothers.backward_simulation import backward_simulation_smoother as backward_simulation_smoother
from poseppl.smoothers.base import (
    Approximation as Approximation,
    History as History,
    Smoothed as Smoothed,
    Smoother as Smoother,
    SmoothingInfo as SmoothingInfo,
    collect_history as collect_history,
)
from poseppl.smoothers.conditional_smc import particle_gibbs_smoother as particle_gibbs_smoother
from poseppl.smoothers.ensemble_kalman import ensemble_kalman_smoother as ensemble_kalman_smoother
from poseppl.smoothers.fixed_lag import (
    FixedLagState as FixedLagState,
    fixed_lag as fixed_lag,
    fixed_lag_smoother as fixed_lag_smoother,
)
from poseppl.smoothers.forward_backward import forward_backward_smoother as forward_backward_smoother
from poseppl.smoothers.genealogy import genealogy_smoother as genealogy_smoother
from poseppl.smoothers.laplace import laplace_smoother as laplace_smoother
from poseppl.smoothers.particle_marginal import pmmh as pmmh
from poseppl.smoothers.published.gibbs import gibbs_smoother as gibbs_smoother
from poseppl.smoothers.published.likelihood_mixture import MixtureSettings as MixtureSettings
from poseppl.smoothers.published.mixture_variational import mixture_variational_smoother as mixture_variational_smoother
from poseppl.smoothers.published.particle_mgrad import particle_mgrad_smoother as particle_mgrad_smoother
from poseppl.smoothers.published.two_filter import two_filter_smoother as two_filter_smoother
from poseppl.smoothers.rauch_tung_striebel import (
    rauch_tung_striebel_smoother as rauch_tung_striebel_smoother,
    smoothed_moments as smoothed_moments,
)
from poseppl.smoothers.trajectory import trajectory_smoother as trajectory_smoother
from poseppl.smoothers.variational import variational_smoother as variational_smoother
from poseppl.smoothers.viterbi import viterbi_smoother as viterbi_smoother
