"""The job in particles: bootstrap filter, backward simulation by rejection with a hybrid fall-back."""

import numpy as np
import particles
from job import DECAY, NOISE, NUM_PARTICLES, STEP
from particles import distributions as dists, state_space_models as ssm

NAME, PACKAGE, METHOD = "particles", "particles", "bootstrap filter, backward simulation"


class Level(ssm.StateSpaceModel):
    def PX0(self):
        return dists.Normal()

    def PX(self, t, xp):
        return dists.Normal(loc=DECAY * xp, scale=STEP)

    def PY(self, t, xp, x):
        return dists.Normal(loc=x, scale=NOISE)

    def upper_bound_log_pt(self, t):
        return -0.5 * np.log(2 * np.pi * STEP**2)


def prepare(data):
    def run(seed):
        np.random.seed(seed)  # noqa: NPY002 (particles draws from it)
        smc = particles.SMC(fk=ssm.Bootstrap(ssm=Level(), data=data), N=NUM_PARTICLES, store_history=True)
        smc.run()
        return np.array([draws.mean() for draws in smc.hist.backward_sampling_reject(NUM_PARTICLES)])

    return run
