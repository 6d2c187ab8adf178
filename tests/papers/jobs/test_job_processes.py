from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from distributed import Client, Security
from job_samples import Draw, assert_same, draw, prepare, save, where
from waiting import PATIENCE, wait_until

from poseppl.errors import InputError
from poseppl.jobs import JobError, Processes, run_jobs
from poseppl.jobs.cluster import available_cores, core_shares, local_workers

linux = pytest.mark.skipif(sys.platform != "linux", reason="cores and processes are looked up as Linux has them")


@pytest.mark.full
def test_processes_give_what_this_process_gives(tmp_path):
    jobs = [Draw(run) for run in range(6)]
    results = run_jobs(draw, jobs, tmp_path / "many", executor=Processes(2))
    assert_same(results, run_jobs(draw, jobs, tmp_path / "one", executor="inline"))


@pytest.mark.full
def test_a_killed_worker_loses_nothing(tmp_path, capfd):
    (tmp_path / "marks").mkdir()
    mishaps = {2: "die", 4: "die"}
    jobs = [Draw(run, mishap=mishaps.get(run, ""), folder=str(tmp_path / "marks")) for run in range(6)]
    results = run_jobs(draw, jobs, tmp_path / "many", executor=Processes(2))
    assert len(list((tmp_path / "marks").iterdir())) == 2  # both did die
    assert_same(results, run_jobs(draw, jobs, tmp_path / "one", executor="inline"))
    assert len(list((tmp_path / "many").iterdir())) == len(jobs)


@pytest.mark.full
def test_a_job_that_always_dies_is_named_and_the_others_are_done(tmp_path):
    jobs = [Draw(run, mishap="die" if run == 1 else "exit" if run == 2 else "fail" if run == 3 else "") for run in range(5)]
    with pytest.raises(JobError) as caught:
        run_jobs(draw, jobs, tmp_path, executor=Processes(1))
    assert caught.value.failures == {
        jobs[1].key: "its process died 3 times (killed, crashed or out of memory)",
        jobs[2].key: "SystemExit: 3",
        jobs[3].key: "ArithmeticError: run 3 does not work",
    }
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.full
def test_jobs_may_write_files_of_their_own(tmp_path):
    """xarray asks who computes, and takes a lock of the scheduler's for it, if nobody says that nothing here is."""
    results = run_jobs(save, [Draw(7, folder=str(tmp_path))], tmp_path / "jobs", executor=Processes(1))
    assert [list(each["run"]) for each in results.values()] == [[7]]


@pytest.mark.full
@linux
def test_each_worker_has_its_share_of_the_cores(tmp_path):
    (tmp_path / "pids").mkdir()
    jobs = [Draw(run, folder=str(tmp_path / "pids")) for run in range(8)]
    results = run_jobs(where, jobs, tmp_path / "jobs", executor=Processes(2, prepare=prepare))
    shares = core_shares(available_cores(), 2)
    found = {int(arrays["pid"]): arrays["cores"].tolist() for arrays in results.values()}
    assert sorted(found.values()) == sorted([share] for share in shares)
    assert all(arrays["prepared"] == "yes" and not arrays["jax"] for arrays in results.values())


def test_shares():
    assert core_shares([0, 1, 2, 3, 4], 2) == [[0, 1, 2], [3, 4]]
    assert core_shares([3, 5], 3) == [[3], [5], [3]]
    assert core_shares([3, 5], 1) == [[3, 5]]


@pytest.mark.full
def test_a_job_that_waits_behind_one_that_dies_is_done(tmp_path):
    jobs = [Draw(0), Draw(1, mishap="die")]
    with pytest.raises(JobError, match="1 of 2 jobs failed.*the others are kept"):
        run_jobs(draw, jobs, tmp_path, executor=Processes(1))
    assert [path.name for path in tmp_path.iterdir()] == [f"{jobs[0].key}.npz"]


@pytest.mark.full
def test_workers_take_no_work_from_strangers():
    with local_workers([[0]], pin=False, prepare=None) as client:
        for security in (None, Security.temporary()):
            address = client.scheduler.address if security else client.scheduler.address.replace("tls://", "tcp://")
            with pytest.raises(OSError, match="closed|certificate"):
                Client(address, security=security, timeout=PATIENCE, set_as_default=False)
        assert client.submit(draw, Draw(0)).result()


def test_what_certificates_are_made_with_is_needed(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(InputError, match=r"requires `cryptography`.*pip install 'poseppl\[experiments\]'"):
        run_jobs(draw, [Draw(0)], tmp_path)


@pytest.mark.full
def test_no_workers_are_refused(tmp_path):
    with pytest.raises(ValueError, match="max_workers is 0"):
        run_jobs(draw, [Draw(0)], tmp_path, executor=Processes(0))


SCRIPT = """
import sys
sys.path[:0] = sys.argv[3:]
from job_samples import Draw, draw
from poseppl.jobs import Processes, run_jobs

if __name__ == "__main__":
    jobs = [Draw(0), *(Draw(run, mishap="sleep", folder=sys.argv[2]) for run in (1, 2)), Draw(3)]
    run_jobs(draw, jobs, sys.argv[1], executor=Processes(2))
"""


@pytest.mark.full
@linux
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_run_leaves_no_process_behind(tmp_path, how):
    folder, marks, script = tmp_path / "results", tmp_path / "marks", tmp_path / "script.py"
    marks.mkdir()
    script.write_text(SCRIPT)
    modules = [str(Path(__file__).parents[up]) for up in (0, 2)]  # of these jobs and of all tests
    command = [sys.executable, str(script), str(folder), str(marks), *modules]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)
    wait_until(lambda: len(list(marks.iterdir())) == 2 and (folder / f"{Draw(3).key}.npz").exists(), process=process)
    assert len(members(process.pid)) >= 3
    if how == signal.SIGINT:
        os.killpg(process.pid, how)  # as a terminal does
    else:
        process.kill()
    assert process.wait(PATIENCE) != 0
    wait_until(lambda: not members(process.pid))
    assert [path.name for path in folder.iterdir()] == [f"{Draw(3).key}.npz"]


def members(session):
    """Processes of a session."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, _, owner = path.read_text().rpartition(")")[2].split()[:4]
            if int(owner) == session and state != "Z":
                found.append(int(path.parent.name))
    return found
