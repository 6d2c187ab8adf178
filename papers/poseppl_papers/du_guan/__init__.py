"""Du and Guan 2006, DE-MC as a filter of people in images, run again."""

from poseppl_papers.du_guan.experiment import EXPERIMENT as EXPERIMENT
