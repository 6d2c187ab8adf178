"""A folder of tables: each has its result, what cannot be used is named, and a second call does only what has changed."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys

import pytest
from test_run_command import exact_evidence, folder as folder  # noqa: F401  a fixture
from waiting import PATIENCE, wait_until

from poseppl.cli import main
from poseppl.cli.model_runs import source_digest
from poseppl.runs.results import load_result


def test_a_folder_of_tables(folder, capsys):  # noqa: F811
    tables = folder / "trials"
    tables.mkdir()
    shutil.copy("data.csv", tables / "first.csv")
    (tables / "second.csv").write_text("push,y[0],y[1]\n0,x,1\n")
    command = ["batch", "trials", "--model", "model.py", "--inputs", "push", "--param", "noise=0.3", "--filter", "kalman"]
    command += ["--workers", "1", "-o", "out"]
    assert main(command) == 1
    told = capsys.readouterr().err
    assert "1 of 2 tables failed: second.csv" in told and "line 2, y[0]: 'x'" in told
    first, second = csv.DictReader((folder / "out/table.csv").read_text().splitlines())
    assert abs(float(first["log evidence"]) - exact_evidence()) < 1e-3 and first["frames"] == "6"
    assert second["severity"] == "failed"
    written = (folder / "out/first.nc").stat().st_mtime_ns
    # # the corrected table is done, the other is not done again
    shutil.copy("data.csv", tables / "second.csv")
    assert main(command) == 0
    assert (folder / "out/first.nc").stat().st_mtime_ns == written
    rows = list(csv.DictReader((folder / "out/table.csv").read_text().splitlines()))
    assert [row["input"] for row in rows] == ["first.csv", "second.csv"]
    assert abs(float(rows[1]["log evidence"]) - exact_evidence()) < 1e-3
    assert load_result(folder / "out/second.nc")["posterior"].sizes["frame"] == 6
    assert "| second.csv | 6 |" in (folder / "out/page.md").read_text()
    # a result that was removed is made again, and so is one in whose place there is that of another filter
    (folder / "out/first.nc").unlink()
    (folder / "out/second.nc").write_bytes(b"of another filter")
    assert main(command) == 0
    for name in ("first", "second"):
        assert load_result(folder / f"out/{name}.nc")["posterior"].sizes["frame"] == 6


@pytest.mark.full
def test_a_module_that_has_changed_is_another_model(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "module_of_mine.py").write_text("model = 1")
    first = source_digest("module_of_mine:model")
    (tmp_path / "module_of_mine.py").write_text("model = 2")
    assert first and source_digest("module_of_mine") not in ("", first)
    assert source_digest("no_such_package.module") == source_digest("no_such_file.py") == ""


@pytest.mark.full
def test_a_folder_without_tables_is_said(folder, capsys):  # noqa: F811
    (folder / "none").mkdir()
    assert main(["batch", "none", "--model", "model.py"]) == 1
    assert "there is no table in it" in capsys.readouterr().err


@pytest.fixture
def scheduler():
    """The address of a Dask scheduler with two workers."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: poseppl[experiments]")
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster:
        yield cluster.scheduler_address


WAITS = """
import sys
from poseppl.cli import main
from poseppl.cli.console import ConsoleProgress

ConsoleProgress.finished = lambda *told: sys.stdin.read()  # until it is killed
raise SystemExit(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("where", ["workers", "scheduler"])
def test_a_killed_batch_goes_on_where_it_was(folder, where, request):  # noqa: F811
    """Killed when the first of eight tables is done, the same command does the others, and that one not again."""
    tables, out, names = folder / "trials", folder / "out", "abcdefgh"
    tables.mkdir()
    for name in names:
        shutil.copy("data.csv", tables / f"{name}.csv")
    command = ["batch", "trials", "--quiet", "--model", "model.py", "--inputs", "push", "--param", "noise=0.3"]
    command += ["--filter", "kalman", "-o", "out", f"--{where}"]
    command += ["1" if where == "workers" else request.getfixturevalue("scheduler")]
    with subprocess.Popen([sys.executable, "-c", WAITS, *command], stdin=subprocess.PIPE) as batch:
        wait_until(lambda: list(out.glob("jobs/[!.]*.npz")), process=batch)
        batch.kill()
    done = {path: path.stat().st_mtime_ns for path in out.glob("jobs/[!.]*.npz")}
    assert len(done) == 1 and not (out / "table.csv").exists()
    whole = "from poseppl.cli import main; raise SystemExit(main())"
    subprocess.run([sys.executable, "-c", whole, *command], check=True, timeout=PATIENCE)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    first = min(done).name[0]
    assert (out / f"{first}.nc").stat().st_mtime_ns < min(done.values())
    rows = list(csv.DictReader((out / "table.csv").read_text().splitlines()))
    assert [row["input"] for row in rows] == [f"{name}.csv" for name in names]
    assert all(abs(float(row["log evidence"]) - exact_evidence()) < 1e-3 for row in rows)
