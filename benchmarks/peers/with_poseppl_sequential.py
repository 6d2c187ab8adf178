"""The job of a long series in poseppl: Kalman filter and smoother, one frame after the other."""

import functools

import with_poseppl_parallel

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "one after the other", "job_parallel"
prepare = functools.partial(with_poseppl_parallel.prepare, parallel=False)
