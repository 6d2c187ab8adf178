"""The job of parameters in poseppl: SMC² with a bootstrap filter."""

import functools

import with_poseppl_pmmh
from job_pmmh import NUM_PARAMS

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "`fit`, SMC², bootstrap filter", "job_smc2"
prepare = functools.partial(with_poseppl_pmmh.prepare, method="smc2", num_params=NUM_PARAMS)
