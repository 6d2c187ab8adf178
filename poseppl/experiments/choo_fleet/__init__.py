"""Choo and Fleet 2001, sections 7.3 to 7.5 (doi:10.1109/ICCV.2001.937643), run again, and beaten where we can."""

from poseppl.experiments.choo_fleet.plan import FULL as FULL, PARTS as PARTS, QUICK as QUICK, Scale as Scale
from poseppl.experiments.choo_fleet.reproduce import reproduce as reproduce
from poseppl.experiments.choo_fleet.systems import BUILT_IN as BUILT_IN, Recording as Recording
