"""The job in 28 dimensions in poseppl, a result with draws: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
from job_linear import NUM_DRAWS
from with_poseppl_linear import initial, observation, transition

import poseppl
from poseppl.filters import kalman_filter
from poseppl.smoothers import rauch_tung_striebel_smoother

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "Kalman, Rauch-Tung-Striebel: a result", "job_linear"


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter, smoother = kalman_filter(model, NUM_DRAWS), rauch_tung_striebel_smoother(model, num_draws=NUM_DRAWS)

    def run(seed):
        result = poseppl.infer(model, {"z": data}, filter, jax.random.key(seed))
        return poseppl.smooth(result, smoother, jax.random.key(seed))["summary/state_mean"].values

    return run
