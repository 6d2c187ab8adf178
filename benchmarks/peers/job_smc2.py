"""The job of parameters by SMC²: that of `job_pmmh`, by a swarm of params that each have a filter."""

from job_pmmh import draw as draw, exact as exact

NUM_RUNS = 1
