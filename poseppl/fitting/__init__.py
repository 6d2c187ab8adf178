"""Estimates of static parameters: one call, eight methods, one form of result.

The function of method ``name`` is ``name_method``.
"""

from poseppl.fitting.fit import FitMethod as FitMethod, fit as fit
from poseppl.fitting.iterated_filtering import iterated_filtering_method as iterated_filtering_method
from poseppl.fitting.optimum import map_method as map_method, ml_method as ml_method
from poseppl.fitting.results import findings_of_fit as findings_of_fit, load_fit as load_fit
from poseppl.fitting.sampling import (
    nuts_method as nuts_method,
    particle_gibbs_method as particle_gibbs_method,
    pmmh_method as pmmh_method,
    svi_method as svi_method,
)
from poseppl.fitting.smc_squared import smc2_method as smc2_method
