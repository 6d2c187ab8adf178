"""Choo and Fleet 2001, sections 7.3 to 7.5 (doi:10.1109/ICCV.2001.937643), run again, and beaten where we can."""

from poseppl_papers.choo_fleet.experiment import EXPERIMENT as EXPERIMENT
from poseppl_papers.choo_fleet.plan import Scale as Scale
