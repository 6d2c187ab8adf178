"""How well `poseppl batch` uses its workers: one and two local processes, and a hundred workers that only wait.

    python -m benchmarks.batch_workers [--quick] [--tables 12] [--frames 300] [--particles 20000] [--simulated 100] [--job 2]

Local: TABLES tables (3 or more; 0 leaves this part out) of FRAMES frames, a particle filter of PARTICLES. A first call
compiles, and is not counted. The efficiency of two workers is the seconds with one over twice the seconds with two; other work
on the machine lowers it. The losses are shown in processor seconds of all processes, from one table a worker and from all:
those of a further table, and those of each process's start (libraries, tracing, reading compiled programs). Simulated: a Dask
scheduler with SIMULATED workers in this process, 10 jobs for each. A job sleeps for JOB seconds and returns a result of a
table's size. The efficiency is the seconds of sleep over the seconds of all workers.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import arguments
from poseppl.jobs import Job, run_jobs
from poseppl.jobs.cluster import Tasks

MODEL = """
import numpyro
import numpyro.distributions as dist
from poseppl import StateSpaceModel

def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))

def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.95 * state["level"], 0.3))

def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["level"], 0.5))

model = StateSpaceModel(initial, transition, observation)
"""
RUN = "from poseppl.cli import main; raise SystemExit(main())"
_TOLD = 2000
"""Bytes of what a table's job tells."""


@dataclass(frozen=True)
class Wait(Job):
    """A job that sleeps."""

    number: int
    seconds: float


def wait(job: Wait) -> dict[str, Any]:
    """Sleep, and return as much as a table's job does."""
    time.sleep(job.seconds)
    return {"told": np.array("x" * _TOLD)}


class Simulated:
    """Workers in this process, as an executor."""

    def __init__(self, number: int) -> None:
        self.number, self.seconds = number, 0.0

    def outcomes(self, function: Any, jobs: Any, note: Any) -> Any:
        """See `poseppl.jobs.Executor`; the start of the workers is not counted."""
        from distributed import Client, LocalCluster

        settings = {"processes": False, "threads_per_worker": 1, "memory_limit": 0, "dashboard_address": None}
        with LocalCluster(n_workers=self.number, **settings) as cluster, Client(cluster, set_as_default=False) as client:
            started = time.perf_counter()
            yield from Tasks(client, function, jobs).outcomes(note)
            self.seconds = time.perf_counter() - started


def simulated(number: int, seconds: float) -> str:
    """Efficiency of so many workers."""
    jobs = [Wait(index, seconds) for index in range(10 * number)]
    workers = Simulated(number)
    with tempfile.TemporaryDirectory() as folder:
        run_jobs(wait, jobs, folder, executor=workers)
    share = len(jobs) * seconds / (number * workers.seconds)
    return f"{number} simulated workers, {len(jobs)} jobs of {seconds:g} s: {workers.seconds:.1f} s, efficiency {share:.2f}"


def local(folder: Path, tables: int, frames: int, particles: int, workers: int) -> tuple[float, float]:
    """Seconds of `poseppl batch` on so many tables, and processor seconds of all its processes."""
    trials = folder / f"trials-{tables}"
    trials.mkdir(exist_ok=True)
    for index in range(tables):
        data = np.random.default_rng(index).normal(size=frames)
        (trials / f"{index}.csv").write_text("\n".join(["y", *(f"{value:.6f}" for value in data), ""]))
    command = [sys.executable, "-c", RUN, "batch", str(trials), "--model", str(folder / "model.py"), "--quiet"]
    command += ["--filter", "particle", "--set", f"num_particles={particles}", "--workers", str(workers)]
    started, before = time.perf_counter(), _processor_seconds()
    with tempfile.TemporaryDirectory(dir=folder) as out:
        subprocess.run([*command, "-o", out], check=True)
    return time.perf_counter() - started, _processor_seconds() - before


def _processor_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def shares(folder: Path, tables: int, frames: int, particles: int) -> str:
    """How well two workers are used, and what they do."""
    local(folder, 1, frames, particles, 1)
    seconds, parts = [], []
    for workers in (1, 2):
        few, all_of_them = (local(folder, number, frames, particles, workers) for number in (workers, tables))
        table = (all_of_them[1] - few[1]) / (tables - workers)
        seconds.append(all_of_them[0])
        parts.append(f"with {workers} {few[1] - workers * table:.1f} processor s to start and {table:.2f} a table")
    one, two = seconds
    share = f"{one:.1f} s with 1 worker, {two:.1f} s with 2, efficiency {one / (2 * two):.2f}"
    return f"{tables} tables of {frames} frames: {share}; {', '.join(parts)}"


def main() -> None:
    options = arguments(__doc__, tables=12, frames=300, particles=20_000, simulated=100, job=2.0)
    tables, frames, particles = (4, 10, 100) if options.quick else (options.tables, options.frames, options.particles)
    if tables:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "model.py").write_text(MODEL)
            print(shares(folder, tables, frames, particles))
    number, seconds = (4, 0.2) if options.quick else (options.simulated, options.job)
    print(simulated(number, seconds))


if __name__ == "__main__":
    main()
