"""The job in poseppl, in closed form: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
from with_poseppl import initial, observation, transition

import poseppl.filters
import poseppl.smoothers

NAME, PACKAGE, METHOD = "poseppl", "poseppl", "Kalman, Rauch-Tung-Striebel"


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter = poseppl.filters.kalman_filter(model, 200)  # as many draws as a result keeps; moments need none
    smoother = poseppl.smoothers.rauch_tung_striebel_smoother(model, num_draws=200)

    def run(seed):
        result = poseppl.infer(model, {"z": data}, filter, jax.random.key(seed))
        return poseppl.smooth(result, smoother, jax.random.key(seed))["summary/state_mean"].values[:, 0]

    return run
