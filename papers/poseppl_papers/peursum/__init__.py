"""Peursum, Venkatesh and West 2010 (doi:10.1007/s11263-009-0205-5), run again."""

from poseppl_papers.peursum.experiment import EXPERIMENT as EXPERIMENT
