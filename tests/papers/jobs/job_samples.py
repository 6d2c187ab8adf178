"""Jobs and functions that other processes import."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from waiting import PATIENCE, wait_until

from poseppl.files.netcdf import write_netcdf
from poseppl.jobs import Job


@dataclass(frozen=True)
class Draw(Job):
    """A mean of draws; `mishap` happens while the file of that name in `folder` does not exist, or always without a folder."""

    run: int
    mishap: str = ""
    folder: str = ""

    @property
    def name(self) -> str:
        return f"draw {self.run}"

    @property
    def cost(self) -> float:
        return 1.0 + self.run


def draw(job: Draw) -> dict[str, np.ndarray]:
    _mishap(job)
    draws = np.random.default_rng(job.run).normal(size=1000)
    return {"mean": draws.mean(), "draws": draws.astype(np.float32)[:10]}


def _mishap(job: Draw) -> None:
    if not job.mishap:
        return
    if job.folder:
        mark = Path(job.folder) / job.key
        if mark.exists():
            return
        mark.touch()
    if job.mishap == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.mishap == "fail":
        raise ArithmeticError(f"run {job.run} does not work")
    if job.mishap == "exit":
        raise SystemExit(3)
    if job.mishap == "sleep":
        time.sleep(PATIENCE)


def where(job: Draw) -> dict[str, object]:
    """The process, the cores of its threads, and whether it has JAX, once two processes have come to `folder`."""
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    cores = {tuple(sorted(os.sched_getaffinity(int(path.name)))) for path in Path("/proc/self/task").iterdir()}
    done.set()
    (Path(job.folder) / str(os.getpid())).touch()
    wait_until(lambda: len(list(Path(job.folder).iterdir())) >= 2)
    return {"pid": os.getpid(), "cores": sorted(cores), "jax": "jax" in sys.modules, "prepared": os.environ.get("PREPARED", "")}


def prepare() -> None:
    os.environ["PREPARED"] = "yes"


def wrong(job: Draw) -> dict[str, object]:
    """Results that a file cannot hold."""
    return {"thing": object()}


def save(job: Draw) -> dict[str, np.ndarray]:
    """Write a NetCDF file and read it, as jobs that render scenes do."""
    path = Path(job.folder) / f"{job.run}.nc"
    write_netcdf(xr.DataTree.from_dict({"/": xr.Dataset({"run": ("x", [job.run])})}), path)
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        return {"run": np.asarray(tree["run"])}


def assert_same(results, expected):
    assert list(results) == list(expected)
    for key, arrays in expected.items():
        for name, array in arrays.items():
            np.testing.assert_array_equal(results[key][name], array, strict=True)
