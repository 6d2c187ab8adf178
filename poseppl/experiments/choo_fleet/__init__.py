"""Choo and Fleet 2001, sections 7.3 to 7.5 (doi:10.1109/ICCV.2001.937643), run again, and beaten where we can."""

from poseppl.experiments.choo_fleet.plan import FULL as FULL
from poseppl.experiments.choo_fleet.plan import PARTS as PARTS
from poseppl.experiments.choo_fleet.plan import QUICK as QUICK
from poseppl.experiments.choo_fleet.plan import Scale as Scale
from poseppl.experiments.choo_fleet.reproduce import reproduce as reproduce
from poseppl.experiments.choo_fleet.systems import BUILT_IN as BUILT_IN
from poseppl.experiments.choo_fleet.systems import Recording as Recording
