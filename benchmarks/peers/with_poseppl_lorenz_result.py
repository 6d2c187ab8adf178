"""The chaotic job in poseppl, a result with draws: ensemble Kalman filter, data perturbed."""

import jax
from job_lorenz import NUM_MEMBERS
from with_poseppl_lorenz import initial, observation, transition

import poseppl
from poseppl.filters import ensemble_kalman_filter

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "ensemble Kalman, stochastic: a result", "job_lorenz"


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter = ensemble_kalman_filter(model, NUM_MEMBERS, form="stochastic")
    return lambda seed: poseppl.infer(model, {"z": data}, filter, jax.random.key(seed))["summary/state_mean"].values
