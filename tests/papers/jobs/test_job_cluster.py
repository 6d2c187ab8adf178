"""A Dask cluster of two local workers."""

from __future__ import annotations

import importlib.util
import socket
import sys

import pytest
from job_samples import Draw, assert_same, draw
from waiting import PATIENCE, wait_until

from poseppl.errors import InputError, PosepplError
from poseppl.jobs import Cluster, JobError, run_jobs

pytestmark = pytest.mark.full

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="Dask is not installed: poseppl[experiments]"
)


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: poseppl[experiments]")
    dask = pytest.importorskip("dask")
    one_death = dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with one_death, distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster:
        yield cluster


def test_a_killed_worker_loses_nothing_and_counts_nothing_twice(cluster, tmp_path):
    (tmp_path / "marks").mkdir()
    jobs = [Draw(run, mishap="die" if run == 8 else "", folder=str(tmp_path / "marks")) for run in range(16)]
    results = run_jobs(draw, jobs, tmp_path / "cluster", executor=Cluster(cluster.scheduler_address, PATIENCE))
    assert len(list((tmp_path / "marks").iterdir())) == 1  # the worker did die
    expected = run_jobs(draw, jobs, tmp_path / "inline", executor="inline")
    assert_same(results, expected)
    files = sorted(path.name for path in (tmp_path / "cluster").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "inline").iterdir())
    again = run_jobs(draw, jobs, tmp_path / "cluster", executor="tcp://127.0.0.1:1")  # all is there: nobody is asked
    assert sum(arrays["mean"] for arrays in again.values()) == sum(arrays["mean"] for arrays in expected.values())


def test_failures_are_named_and_the_others_are_done(cluster, tmp_path):
    jobs = [Draw(0), Draw(1, mishap="fail"), Draw(2), Draw(3, mishap="die")]
    with pytest.raises(JobError) as caught:
        run_jobs(draw, jobs, tmp_path, executor=Cluster(cluster.scheduler_address, PATIENCE))
    assert caught.value.failures == {
        jobs[1].key: "ArithmeticError: run 1 does not work",
        jobs[3].key: "its process died 4 times (killed, crashed or out of memory)",
    }
    assert len(list(tmp_path.iterdir())) == 2


@needs_dask
def test_schedulers_that_are_not_there(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    address, unknown = f"tcp://127.0.0.1:{port}", "carrier-pigeon://host:1"
    for name, executor in ((address, Cluster(address, timeout=1)), (unknown, unknown)):
        with pytest.raises(InputError, match=f"no Dask scheduler answers at {name}"):
            run_jobs(draw, [Draw(0)], tmp_path, executor=executor)


@needs_dask
def test_a_scheduler_without_workers(tmp_path, monkeypatch):
    """It may take long to answer; workers that never come are not waited for."""
    from distributed import Client, LocalCluster

    wait_for_workers = Client.wait_for_workers
    monkeypatch.setattr(Client, "wait_for_workers", lambda client, number, timeout: wait_for_workers(client, number, 0.1))
    with LocalCluster(1, processes=False, dashboard_address=":0", silence_logs=50, protocol="tcp://") as cluster:
        cluster.scale(0)
        wait_until(lambda: not cluster.scheduler_info["workers"])
        with pytest.raises(InputError, match="has no workers"):
            run_jobs(draw, [Draw(0)], tmp_path, executor=Cluster(cluster.scheduler_address, PATIENCE))


@needs_dask
def test_a_lost_scheduler(tmp_path):
    from distributed import LocalCluster

    cluster = LocalCluster(1, threads_per_worker=1, dashboard_address=":0", silence_logs=50)
    jobs = [Draw(0), Draw(1), Draw(2, mishap="sleep"), Draw(3)]
    address = cluster.scheduler_address

    class Closing:
        def started(self, total, done, cost):
            pass

        def finished(self, cost):
            cluster.close()

        def note(self, message):
            pass

    with pytest.raises(PosepplError, match="was lost; finished jobs are kept"):
        run_jobs(draw, jobs, tmp_path, executor=Cluster(address, PATIENCE), progress=Closing())
    assert [path.name for path in tmp_path.iterdir()] == [f"{jobs[3].key}.npz"]


def test_a_missing_dask_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"Dask is not installed \(expected pip install 'poseppl\[experiments\]'\)"):
        run_jobs(draw, [Draw(0)], tmp_path, executor="tcp://127.0.0.1:8786")
