"""The job of many series in poseppl: a Kalman filter of all of them, and a result."""

import jax
from with_poseppl import initial, observation, transition

import poseppl

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "Kalman, 1,000 series: a result", "job_series"


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter = poseppl.kalman_filter(model)

    def run(seed):
        result = poseppl.infer_batch(model, {"z": data}, filter, jax.random.key(seed))
        return result["summary/state_mean"].values[..., 0]

    return run
