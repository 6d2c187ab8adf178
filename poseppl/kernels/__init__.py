"""Moves that leave a density invariant, and the local geometry that they are scaled by."""

from poseppl.kernels.constraints import Constraints as Constraints
from poseppl.kernels.constraints import constraints as constraints
from poseppl.kernels.demc import DEMCChains as DEMCChains
from poseppl.kernels.demc import DEMCSettings as DEMCSettings
from poseppl.kernels.demc import demc_chains as demc_chains
from poseppl.kernels.face_laplace import FaceModes as FaceModes
from poseppl.kernels.hmc import Chains as Chains
from poseppl.kernels.hmc import HMCSettings as HMCSettings
from poseppl.kernels.hmc import hmc_chains as hmc_chains
from poseppl.kernels.laplace import Whitening as Whitening
from poseppl.kernels.laplace import find_modes as find_modes
from poseppl.kernels.laplace import mode_log_weights as mode_log_weights
from poseppl.kernels.laplace import whitening as whitening
from poseppl.kernels.mode_search import search_modes as search_modes
from poseppl.kernels.moves import HMC_MOVES as HMC_MOVES
from poseppl.kernels.moves import RANDOM_WALK_MOVES as RANDOM_WALK_MOVES
from poseppl.kernels.moves import MoveSettings as MoveSettings
from poseppl.kernels.trust_region import climb_modes as climb_modes
