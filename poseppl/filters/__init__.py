"""Filters: one algorithm a file, each a pair of pure functions `init` and `step`."""

from poseppl.filters.base import Filter as Filter
from poseppl.filters.base import FilterState as FilterState
from poseppl.filters.base import Info as Info
from poseppl.filters.particle import ParticleState as ParticleState
from poseppl.filters.particle import particle_filter as particle_filter
