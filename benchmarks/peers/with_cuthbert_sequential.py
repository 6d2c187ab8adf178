"""The job of a long series in cuthbert: square-root Kalman filter and smoother, one frame after the other."""

import functools

import with_cuthbert_parallel

NAME, PACKAGE, METHOD, JOB = "cuthbert", "cuthbert", "one after the other", "job_parallel"
prepare = functools.partial(with_cuthbert_parallel.prepare, parallel=False)
