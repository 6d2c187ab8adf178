"""Jobs of `poseppl batch`: how they are run, those of tables, and the overview of these."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from poseppl.cli.console import ConsoleProgress, start_jax
from poseppl.cli.model_runs import described, filtered, smoothed
from poseppl.cli.options import as_options
from poseppl.cli.outputs import write_outputs
from poseppl.errors import PosepplError
from poseppl.files.atomic_writing import write_atomically, write_rows
from poseppl.files.numpy_arrays import SUFFIX, read_part
from poseppl.jobs import Inline, Job, JobError, Processes, run_jobs

_COLUMNS = ("input", "frames", "impossible frames", "log evidence", "seconds")


@dataclass(frozen=True)
class TableJob(Job):
    """A table, the model and what is done with it; the digests tell a file that has changed."""

    version: ClassVar[int] = 3
    table: str
    digest: str
    model: str
    source: str
    folder: str
    filter_name: str
    settings: tuple[tuple[str, str], ...]
    inputs: tuple[str, ...]
    params: tuple[tuple[str, Any], ...]
    smooth: str
    hindcast: int
    seed: int
    max_draws: int
    history_mib: float
    fill_gaps: bool

    @property
    def name(self) -> str:
        """That of the table."""
        return Path(self.table).stem

    @property
    def cost(self) -> float:
        """The table's size."""
        return float(max(Path(self.table).stat().st_size, 1))


class Notes:
    """Messages of a run, collected for the overview."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def stage(self, description: str, total: int | None = None) -> None:
        """Nothing is shown."""

    def advance(self, frames: int) -> None:
        """Nothing is shown."""

    def note(self, message: str) -> None:
        """Keep it."""
        self.said.append(message)


def run_batch(
    function: Callable[[Any], dict[str, Any]], jobs: Sequence[Job], target: Path, options: Mapping[str, Any], doing: str
) -> list[dict[str, Any]]:
    """Run the jobs whose results are not in a folder, and return the record of each.

    Args:
        function: Computes a job and returns its record, as JSON, as ``record``; its ``digests`` are of files in the folder.
        jobs: The jobs.
        target: The folder.
        options: Those of the command: workers or scheduler, and whether it is quiet.
        doing: The activity, for the bar of progress.

    Returns:
        The records. That of a job which failed in another way than by its input has ``error``; the job is done again next time.
    """
    here = Inline() if options["workers"] == 1 else Processes(options["workers"], prepare=start_jax)
    kept, executor = target / "jobs", options["scheduler"] or here
    forget_lost(jobs, kept, target)
    failures: dict[str, str] = {}
    with ConsoleProgress(options["quiet"], doing=doing, unit="jobs").running() as progress:
        try:
            found = run_jobs(function, jobs, kept, executor=executor, progress=progress)
        except JobError as error:
            failures = error.failures
            found = run_jobs(function, [job for job in jobs if job.key not in failures], kept)
    return [
        {"input": job.name, "error": failures[job.key]} if job.key in failures else json.loads(str(found[job.key]["record"]))
        for job in jobs
    ]


def run_table(job: TableJob) -> dict[str, Any]:
    """Filter a table, write its result and picture, and tell what came of it, as JSON, with ``error`` where it failed."""
    options = {**vars(job), "settings": dict(job.settings), "params": dict(job.params)}
    notes = Notes()
    try:
        found = filtered(job.model, job.table, options, notes)
        target = Path(job.folder) / f"{job.name}.nc"
        record = described(found.result, write_outputs(found.result, target, notes.note))
        results = [target]
        if job.smooth:
            results.append(target.with_name(f"{job.name}-{job.smooth}.nc"))
            write_outputs(smoothed(found, options, notes), results[1], notes.note)
        record["digests"] = {path.name: digest_of(path) for path in results}
    except PosepplError as error:
        record = failure(Path(job.table).name, error)
    return {"record": np.array(json.dumps({**record, "notes": notes.said}))}


def failure(name: str, error: PosepplError) -> dict[str, Any]:
    """The record of what failed, and whether it is to be done again, since a full disk is nothing of the input."""
    return {"input": name, "error": as_options(error), "again": type(error) is PosepplError}


def digest_of(path: Path) -> str:
    """That of a file's bytes; nothing where there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else ""


def forget_lost(jobs: Iterable[Job], kept: Path, folder: Path) -> None:
    """Have those jobs done again whose results are no longer in the folder as they were written, or could not be written.

    Somebody may have removed them, or another filter written its own in their place.
    """
    for job in jobs:
        path = kept / f"{job.key}.npz"
        try:
            with zipfile.ZipFile(path) as archive:
                record = json.loads(str(read_part(archive, f"record{SUFFIX}", path.stat().st_size)))
        except Exception:  # there is none, or a damaged one, which is reported where it is read
            continue
        if record.get("again") or any(digest_of(folder / name) != digest for name, digest in record.get("digests", {}).items()):
            path.unlink()


def write_overview(rows: Sequence[dict[str, Any]], folder: Path) -> list[str]:
    """Write ``table.csv`` and ``page.md``, and say which tables failed, and why."""
    head = [*_COLUMNS, "severity", "verdict"]
    lines = [[*(_cell(row.get(name)) for name in _COLUMNS), *_verdict(row)] for row in rows]
    write_rows(folder / "table.csv", [head, *lines])
    shown = [f"| {' | '.join(word.replace('|', '/') for word in line)} |" for line in lines]
    failed = [f"{row['input']}: {row['error']}" for row in rows if "error" in row]
    about = f"{len(rows)} tables, {len(failed)} failed. Each has its result NAME.nc and its picture NAME.png beside this page."
    page = ["# Results", "", about, "", f"| {' | '.join(head)} |", "| --- " * len(head) + "|", *shown, ""]
    write_atomically(folder / "page.md", "\n".join(page))
    return failed


def _verdict(row: dict[str, Any]) -> tuple[str, str]:
    """The worst verdict, or why there is none."""
    if "error" in row:
        return "failed", row["error"]
    return (row["verdicts"][0]["severity"], row["verdicts"][0]["text"]) if row["verdicts"] else ("", "")


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
