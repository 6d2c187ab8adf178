"""The job of parameters in particles: SMC² with a bootstrap filter, in logarithms."""

import numpy as np
import particles
from job_pmmh import NUM_PARAMS, NUM_PARTICLES
from particles import smc_samplers
from with_particles_pmmh import Level, prior_of_logarithms

NAME, PACKAGE, METHOD, JOB = "particles", "particles", "SMC², bootstrap filter", "job_smc2"


def prepare(data):
    def run(seed):
        np.random.seed(seed)  # noqa: NPY002 (particles draws from it)
        moves = {"wastefree": False, "len_chain": 4}
        model = smc_samplers.SMC2(ssm_cls=Level, prior=prior_of_logarithms(), data=data, init_Nx=NUM_PARTICLES, **moves)
        swarm = particles.SMC(fk=model, N=NUM_PARAMS)
        swarm.run()
        return np.array([np.average(swarm.X.theta[name], weights=swarm.W) for name in ("step", "noise")])

    return run
