"""Jobs of `poseppl batch`, one a table, and the overview of them."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from poseppl.cli.model_runs import described, filtered, smoothed
from poseppl.cli.outputs import write_outputs
from poseppl.errors import PosepplError
from poseppl.files.atomic_writing import write_atomically, write_rows
from poseppl.files.npz_reading import SUFFIX, read_part
from poseppl.jobs import Job

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
    params: tuple[tuple[str, float], ...]
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


class _Notes:
    """What a run says on the way, kept for the overview."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def stage(self, description: str, total: int | None = None) -> None:
        """Nothing is shown."""

    def advance(self, frames: int) -> None:
        """Nothing is shown."""

    def note(self, message: str) -> None:
        """Keep it."""
        self.said.append(message)


def run_table(job: TableJob) -> dict[str, Any]:
    """Filter a table, write its result and picture, and tell what came of it, as JSON, with ``error`` where it failed."""
    options = {**vars(job), "settings": dict(job.settings), "params": dict(job.params)}
    notes = _Notes()
    try:
        found = filtered(job.model, job.table, options, notes)
        target = Path(job.folder) / f"{job.name}.nc"
        told = described(found.result, write_outputs(found.result, target, notes.note))
        results = [target]
        if job.smooth:
            results.append(target.with_name(f"{job.name}-{job.smooth}.nc"))
            write_outputs(smoothed(found, options, notes), results[1], notes.note)
        told["digests"] = {path.name: digest_of(path) for path in results}
    except PosepplError as error:
        told = {"input": Path(job.table).name, "error": str(error)}
    return {"told": np.array(json.dumps({**told, "notes": notes.said}))}


def digest_of(path: Path) -> str:
    """That of a file's bytes; nothing where there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else ""


def forget_lost(jobs: Iterable[TableJob], kept: Path, folder: Path) -> None:
    """Have those tables done again whose results are no longer in the folder as they were written.

    Somebody may have removed them, or another filter written its own in their place.
    """
    for job in jobs:
        path = kept / f"{job.key}.npz"
        try:
            with zipfile.ZipFile(path) as archive:
                told = json.loads(str(read_part(archive, f"told{SUFFIX}", path.stat().st_size)))
        except Exception:  # there is none, or a damaged one, which is told where it is read
            continue
        if any(digest_of(folder / name) != digest for name, digest in told.get("digests", {}).items()):
            path.unlink()


def write_overview(results: Sequence[dict[str, Any]], folder: Path) -> list[str]:
    """Write ``table.csv`` and ``page.md``, and say which tables failed, and why."""
    rows = [json.loads(str(each["told"])) for each in results]
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
