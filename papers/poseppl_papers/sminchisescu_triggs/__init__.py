"""Sminchisescu and Triggs 2001, section 5 (doi:10.1109/CVPR.2001.990509): what makes a tracker lose a body."""

from poseppl_papers.sminchisescu_triggs.experiment import EXPERIMENT as EXPERIMENT
