"""The job of parameters in particles: PMMH with an adaptive random walk, in logarithms."""

import numpy as np
from job import DECAY
from job_pmmh import NUM_DRAWS, NUM_PARTICLES, NUM_WARMUP, PRIOR
from particles import distributions as dists, mcmc, state_space_models as ssm

NAME, PACKAGE, METHOD, JOB = "particles", "particles", "PMMH, bootstrap filter", "job_pmmh"


class Level(ssm.StateSpaceModel):
    def PX0(self):
        return dists.Normal()

    def PX(self, t, xp):
        return dists.Normal(loc=DECAY * xp, scale=np.exp(self.step))

    def PY(self, t, xp, x):
        return dists.Normal(loc=x, scale=np.exp(self.noise))


def prior_of_logarithms():
    return dists.StructDist({"step": dists.Normal(*PRIOR[0]), "noise": dists.Normal(*PRIOR[1])})


def prepare(data):
    def run(seed):
        np.random.seed(seed)  # noqa: NPY002 (particles draws from it)
        chain = mcmc.PMMH(ssm_cls=Level, prior=prior_of_logarithms(), data=data, Nx=NUM_PARTICLES, niter=NUM_WARMUP + NUM_DRAWS)
        chain.run()
        return np.array([chain.chain.theta[name][NUM_WARMUP:].mean() for name in ("step", "noise")])

    return run
