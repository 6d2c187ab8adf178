"""Darby, Li and Costen 2008 (doi:10.1109/AFGR.2008.4813348), run again."""

from poseppl_papers.darby.experiment import EXPERIMENT as EXPERIMENT
