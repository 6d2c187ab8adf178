"""Filters: one algorithm a file, each a pair of pure functions `init` and `step`."""

from poseppl.filters.assumed_density import assumed_density_filter as assumed_density_filter
from poseppl.filters.base import Filter as Filter, FilterInfo as FilterInfo, FilterState as FilterState
from poseppl.filters.chains import ChainState as ChainState
from poseppl.filters.ensemble_kalman import (
    EnsembleState as EnsembleState,
    ensemble_kalman_filter as ensemble_kalman_filter,
)
from poseppl.filters.guided import guided_filter as guided_filter
from poseppl.filters.hidden_markov import hidden_markov_filter as hidden_markov_filter
from poseppl.filters.kalman import KalmanState as KalmanState, kalman_filter as kalman_filter
from poseppl.filters.particle import particle_filter as particle_filter
from poseppl.filters.published.activity_guided import activity_guided_filter as activity_guided_filter
from poseppl.filters.published.annealed import AnnealedState as AnnealedState, annealed_filter as annealed_filter
from poseppl.filters.published.covariance_scaled import (
    ModeState as ModeState,
    covariance_scaled_filter as covariance_scaled_filter,
)
from poseppl.filters.published.demc import DEMCState as DEMCState, demc_filter as demc_filter
from poseppl.filters.published.hmc import hmc_filter as hmc_filter
from poseppl.filters.rao_blackwellised import (
    CollapsedState as CollapsedState,
    rao_blackwellised_filter as rao_blackwellised_filter,
)
from poseppl.filters.sequential_monte_carlo import ParticleState as ParticleState
from poseppl.filters.sharding import sharded as sharded
from poseppl.filters.switching import SwitchingState as SwitchingState, switching_filter as switching_filter
from poseppl.filters.tempered import TemperedState as TemperedState, tempered_filter as tempered_filter
from poseppl.filters.window import WindowState as WindowState, window_filter as window_filter
