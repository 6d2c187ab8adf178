"""Independent jobs: described by plain values, computed by one process, many, or a Dask cluster, kept one file each.

    @dataclass(frozen=True)
    class Estimate(Job):
        method: str
        run: int

    def estimate(job: Estimate) -> dict[str, np.ndarray]: ...

    results = run_jobs(estimate, [Estimate("hmc", run) for run in range(50)], "results/")
    results[Estimate("hmc", 7).key]["mean"]

A second call computes what is missing and reads the rest.
"""

from __future__ import annotations

from poseppl.jobs.cluster import Cluster as Cluster, Processes as Processes
from poseppl.jobs.job import Executor as Executor, Inline as Inline, Job as Job, Outcome as Outcome
from poseppl.jobs.run import JobError as JobError, JobProgress as JobProgress, run_jobs as run_jobs
