from __future__ import annotations

import io
import json
import os
import time
import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from damage import damaged_copies, deflated, unbalanced
from job_samples import Draw, draw, wrong

from poseppl.cli.console import ConsoleProgress
from poseppl.errors import InputError
from poseppl.jobs import Job, JobError, run_jobs

JOBS = [Draw(run) for run in range(4)]


class Listener:
    """Records its calls."""

    def __init__(self):
        self.notes, self.costs, self.start = [], [], None

    def started(self, total, done, cost):
        self.start = (total, done, cost)

    def finished(self, cost):
        self.costs.append(cost)

    def note(self, message):
        self.notes.append(message)


def run(jobs, folder, function=draw, **options):
    listener = Listener()
    return run_jobs(function, jobs, folder, executor="inline", progress=listener, **options), listener


def test_results_by_key_and_on_disk(tmp_path):
    results, listener = run(JOBS, tmp_path / "a" / "b")
    assert list(results) == [job.key for job in JOBS]
    assert sorted(os.listdir(tmp_path / "a" / "b")) == sorted(f"{job.key}.npz" for job in JOBS)
    for job in JOBS:
        assert results[job.key]["mean"] == np.random.default_rng(job.run).normal(size=1000).mean()
    assert listener.start == (4, 0, 10.0) and listener.costs == [4.0, 3.0, 2.0, 1.0] and not listener.notes


def test_a_second_call_computes_what_is_missing(tmp_path):
    first, _ = run(JOBS, tmp_path)
    (tmp_path / f"{JOBS[2].key}.npz").unlink()
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    second, listener = run([*JOBS, Draw(9)], tmp_path)
    assert listener.start == (5, 3, 13.0) and listener.costs == [10.0, 3.0]
    assert all(path.stat().st_mtime_ns == then for path, then in times.items())
    for job in JOBS:
        for name, array in first[job.key].items():
            np.testing.assert_array_equal(second[job.key][name], array, strict=True)


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "foreign", "format", "versions"])
def test_files_that_cannot_be_used_are_computed_again(tmp_path, damage):
    expected, _ = run(JOBS, tmp_path)
    path = tmp_path / f"{JOBS[1].key}.npz"
    data = bytearray(path.read_bytes())
    if damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "flipped":
        data[data.index(b"\x93NUMPY") + 130] ^= 1
        path.write_bytes(data)
    elif damage == "empty":
        path.write_bytes(b"")
    elif damage == "foreign":
        np.savez(path, mean=1.0)
    else:
        rewrite_record(path, **{damage: 0 if damage == "format" else {"jax": "0.1"}})
    results, listener = run(JOBS, tmp_path)
    assert listener.start == (4, 3, 2.0) and len(listener.notes) == 1 and "computed again" in listener.notes[0]
    assert results[JOBS[1].key]["mean"] == expected[JOBS[1].key]["mean"]
    assert run(JOBS, tmp_path)[1].start == (4, 4, 0)


def rewrite_record(path, **changes: Any):
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    record = json.loads(arrays["__record__"].tobytes()) | changes
    arrays["__record__"] = np.frombuffer(json.dumps(record).encode(), np.uint8)
    np.savez(path, **arrays)


def test_files_of_other_jobs_are_left_alone(tmp_path):
    run(JOBS[:1], tmp_path)
    path = tmp_path / f"{JOBS[0].key}.npz"
    os.rename(path, tmp_path / f"{JOBS[1].key}.npz")
    with pytest.raises(InputError, match="another job"):
        run(JOBS[:2], tmp_path)
    os.rename(tmp_path / f"{JOBS[1].key}.npz", path)
    with pytest.raises(InputError, match="holds results of another function.*job_samples.draw"):
        run(JOBS[:1], tmp_path, function=wrong)
    assert path.exists()


@pytest.mark.full
def test_a_result_damaged_anywhere_is_computed_again(tmp_path):
    wanted, _ = run(JOBS[:1], tmp_path)
    path = tmp_path / f"{JOBS[0].key}.npz"
    told = 0
    data = path.read_bytes()
    for damaged in [unbalanced(data), deflated(data), *damaged_copies(data, 100)]:
        path.write_bytes(damaged)
        found, listener = run(JOBS[:1], tmp_path)
        for name, values in wanted[JOBS[0].key].items():
            np.testing.assert_array_equal(found[JOBS[0].key][name], values)
        assert all("computed again" in note for note in listener.notes)
        told += len(listener.notes)
    assert told > 80


def test_what_is_recorded(tmp_path):
    run(JOBS[:1], tmp_path)
    with zipfile.ZipFile(tmp_path / f"{JOBS[0].key}.npz") as file, file.open("__record__.npy") as stream:
        record = json.loads(np.load(io.BytesIO(stream.read())).tobytes())
    assert record["job"] == {"class": "job_samples.Draw", "version": 1, "fields": {"run": 0, "mishap": "", "folder": ""}}
    assert record["function"] == "job_samples.draw" and record["seconds"] > 0 and "jax" in record["versions"]


def test_a_failing_job_does_not_stop_the_others(tmp_path):
    jobs = [*JOBS, Draw(7, mishap="fail"), Draw(8, mishap="fail")]
    with pytest.raises(JobError, match=r"(?s)2 of 6 jobs failed.*draw-8-\w+: ArithmeticError: run 8 does not work") as caught:
        run(jobs, tmp_path)
    assert set(caught.value.failures) == {jobs[4].key, jobs[5].key} and "_mishap" in caught.value.traces[jobs[4].key]
    assert len(list(tmp_path.glob("*.npz"))) == 4
    assert run(JOBS, tmp_path)[1].start == (4, 4, 0)


def test_an_interrupt_leaves_whole_files(tmp_path):
    def stop(cost):
        raise KeyboardInterrupt

    listener = Listener()
    listener.finished = stop
    with pytest.raises(KeyboardInterrupt):
        run_jobs(draw, JOBS, tmp_path, executor="inline", progress=listener)
    assert [path.name for path in tmp_path.iterdir()] == [f"{JOBS[3].key}.npz"]
    assert run(JOBS, tmp_path)[1].start == (4, 1, 6.0)


def test_temporary_files_of_the_dead_are_removed(tmp_path):
    old, young = tmp_path / ".a.0123456789ab.tmp.npz", tmp_path / ".b.0123456789ab.tmp.npz"
    old.touch(), young.touch()
    os.utime(old, (time.time() - 7200, time.time() - 7200))
    run(JOBS[:1], tmp_path)
    assert not old.exists() and young.exists()


@dataclass(frozen=True)
class Nested(Job):
    values: Any


@dataclass(frozen=True)
class Newer(Nested):
    version = 2


def test_another_version_has_another_key(monkeypatch):
    key = Nested(0).key
    monkeypatch.setattr(Nested, "version", 2)
    assert Nested(0).key != key


def test_keys():
    assert len({Nested(value).key for value in (1, 1.5, "1", (1, 2), None, True, {"a": 1}, {"a": 2})}) == 8
    assert Nested({"a": 1, "b": 2}).key == Nested({"b": 2, "a": 1}).key
    assert Nested(0).key != Newer(0).key
    assert Draw(3).key.startswith("draw-3-") and Nested("../x").key.startswith("nested-")
    with pytest.raises(ValueError, match="Nested: .*not JSON serializable.*numbers, texts"):
        _ = Nested(np.zeros(2)).key
    with pytest.raises(TypeError, match="Named: a job has name already"):

        class Named(Job):
            name: str


def test_what_is_refused(tmp_path):
    with pytest.raises(ValueError, match="two jobs are equal: Draw"):
        run([*JOBS, Draw(0)], tmp_path)
    with pytest.raises(ValueError, match="top level of a module"):
        run(JOBS, tmp_path, function=lambda job: {})
    with pytest.raises(JobError, match="thing.*is of type object"):
        run(JOBS, tmp_path, function=wrong)
    with pytest.raises(InputError, match="no executor 'threads'"):
        run_jobs(draw, JOBS, tmp_path, executor="threads")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="no results can be kept there"):
        run(JOBS, tmp_path / "file")
    assert run([], tmp_path)[0] == {}


def test_the_time_left():
    bar, now = ConsoleProgress(False, "drawing", "jobs"), [100.0]
    bar._bar.get_time = lambda: now[0]
    bar.started(5, 3, 10.0)
    (task,) = bar._bar.tasks
    assert task.time_remaining is None
    now[0] = 104.0
    bar.finished(2.0)
    assert task.time_remaining == 16.0
    now[0] = 3600.0
    bar.finished(8.0)
    assert task.time_remaining == 0.0


def test_lines_where_there_is_no_terminal(capsys):
    bar, now = ConsoleProgress(False, "drawing", "jobs"), [0.0]
    bar._told, bar._bar.get_time = 0.0, lambda: now[0]
    bar.started(4, 0, 4.0)
    for now[0] in (29.0, 31.0, 60.0, 62.0):
        bar.finished(1.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["poseppl: drawing, 2/4 jobs, 0:00:31, 0:00:31 left", "poseppl: drawing, 4/4 jobs, 0:01:02, 0:00:00 left"]
    now[0] = 0.0
    quiet = ConsoleProgress(True, "drawing", "jobs")
    quiet._told, quiet._bar.get_time = 0.0, lambda: now[0]
    quiet.started(2, 0, 2.0)
    now[0] = 40.0
    quiet.finished(1.0)
    assert capsys.readouterr().err == ""


@pytest.mark.full
def test_the_bar(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "150")
    monkeypatch.setenv("TERM", "xterm")  # a dumb terminal shows no bar
    bar = ConsoleProgress(False, "drawing", "jobs")
    with bar.running():
        run_jobs(draw, JOBS[:3], tmp_path, executor="inline", progress=bar)
        bar.note("so it is")
        bar._bar.refresh()
    shown = capsys.readouterr().err
    assert "drawing" in shown and "3/3 jobs" in shown and "0:00:00" in shown and "poseppl: so it is" in shown
    monkeypatch.delenv("FORCE_COLOR")
    with ConsoleProgress(False, "drawing", "jobs").running() as quiet:
        run_jobs(draw, JOBS, tmp_path, executor="inline", progress=quiet)
    assert capsys.readouterr().err == ""
