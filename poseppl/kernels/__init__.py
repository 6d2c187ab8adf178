"""Moves that leave a density invariant, and the local geometry that they are scaled by."""

from poseppl.kernels.constraints import Constraints as Constraints, constraints as constraints
from poseppl.kernels.demc import DEMCChains as DEMCChains, DEMCSettings as DEMCSettings, demc_chains as demc_chains
from poseppl.kernels.face_laplace import FaceModes as FaceModes
from poseppl.kernels.gibbs import gibbs_kernel as gibbs_kernel
from poseppl.kernels.hmc import Chains as Chains, HMCSettings as HMCSettings, hmc_chains as hmc_chains
from poseppl.kernels.laplace import (
    Whitening as Whitening,
    find_modes as find_modes,
    mode_log_weights as mode_log_weights,
    whitening as whitening,
)
from poseppl.kernels.mode_search import search_modes as search_modes
from poseppl.kernels.moves import HMC_MOVES as HMC_MOVES, RANDOM_WALK_MOVES as RANDOM_WALK_MOVES, MoveSettings as MoveSettings
from poseppl.kernels.own_kernel import CustomKernel as CustomKernel
from poseppl.kernels.trust_region import climb_modes as climb_modes
