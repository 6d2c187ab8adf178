"""The bodytrack benchmark (Deutscher and Reid 2005, doi:10.1023/B:VISI.0000043757.18370.9c): likelihood and estimates."""

from poseppl_papers.bodytrack.experiment import EXPERIMENT as EXPERIMENT
