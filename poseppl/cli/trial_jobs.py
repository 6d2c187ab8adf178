"""Jobs of `poseppl batch keypoints`, one a trial, with all people that are tracked in it; and the table and page of all."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from poseppl.cli.batch_jobs import Notes, digest_of, failure
from poseppl.cli.export import write_exports
from poseppl.cli.model_runs import source_digest
from poseppl.cli.options import as_option, as_options
from poseppl.cli.outputs import write_outputs
from poseppl.diagnostics import verdicts
from poseppl.errors import InputError, PosepplError
from poseppl.files.atomic_writing import write_atomically, write_rows
from poseppl.jobs import Job
from poseppl.motion import KeypointSettings, track
from poseppl.motion.keypoints.scene import people_of_keypoints
from poseppl.motion.keypoints.trials import Trial
from poseppl.motion.report.pages import trials_html
from poseppl.motion.settings import TrackSettings
from poseppl.motion.tracking.estimates import clock_of
from poseppl.motion.tracking.gait import gait_of, measure_rows
from poseppl.motion.verdicts.residuals import image_errors
from poseppl.runs.contents import variable

LEVEL = 0.9
"""Probability of the intervals in the table."""
SAME_PLACE = 250.0
"""mm between two people, in the median over frames and joints, below which they may be one; ours."""
MANY = 4
"""People who are sought beyond those that are tracked, so that they are reported."""


@dataclass(frozen=True)
class TrialJob(Job):
    """A trial, and how its people are tracked; the digest tells a file that has changed."""

    version: ClassVar[int] = 1
    trial: str
    files: tuple[tuple[str, str], ...]
    calibration: str
    digest: str
    folder: str
    settings: tuple[tuple[str, Any], ...]
    people: int
    seed: int
    max_draws: int | None

    @property
    def name(self) -> str:
        """That of the trial."""
        return self.trial

    @property
    def cost(self) -> float:
        """Bytes of the keypoints."""
        return float(max(sum(_size(Path(path)) for _, path in self.files), 1))

    @property
    def source(self) -> KeypointSettings:
        """The settings of its first person."""
        known: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in self.settings}
        return KeypointSettings(dict(self.files), self.calibration, **known)


def _size(path: Path) -> int:
    return sum(each.stat().st_size for each in _files_of(path))


def _files_of(path: Path) -> list[Path]:
    return sorted(each for each in path.iterdir() if each.is_file()) if path.is_dir() else [path]


def digest_of_trial(trial: Trial, shared: KeypointSettings) -> str:
    """That of all that is read for a trial."""
    digest = hashlib.sha256(source_digest(shared.model or "").encode())
    noise = [Path(shared.noise)] if isinstance(shared.noise, str) else []
    for path in (*trial.files.values(), trial.calibration, *noise):
        for file in _files_of(path):
            digest.update(f"{file.name} {digest_of(file)}\n".encode())
    return digest.hexdigest()[:16]


def run_trial(job: TrialJob) -> dict[str, Any]:
    """Track the people of a trial and write their results; the record, as JSON, has a row of each person."""
    try:
        seen = people_of_keypoints(job.source, job.people + MANY)
        people = [_tracked(job, person) for person in range(1, max(min(seen, job.people), 1) + 1)]
    except PosepplError as error:
        return {"record": np.array(json.dumps(failure(job.trial, error)))}
    rows = [row for row, _, _ in people]
    known = [(row, places) for row, places, _ in people if places is not None]
    for number, (row, places) in enumerate(known):
        row["notes"] += [
            f"persons {other['person']} and {row['person']} are at the same place: they may be one"
            for other, before in known[:number]
            if np.median(np.linalg.norm(places - before, axis=-1)) < SAME_PLACE
        ]
    if seen > len(rows):
        more = "or more " if seen == job.people + MANY else ""
        rows[0]["notes"].append(f"{seen} {more}people are seen by two cameras; --people {seen} tracks all of them")
    files = {name: digest for _, _, written in people for name, digest in written.items()}
    again = any(row.get("again") for row in rows)
    record = {"input": job.trial, "people seen": seen, "rows": rows, "digests": files, "again": again}
    return {"record": np.array(json.dumps(record))}


def _tracked(job: TrialJob, person: int) -> tuple[dict[str, Any], Any, dict[str, str]]:
    """A person's row, mean places (T, K, 3) and the digests of files; of one who cannot be tracked the row says why."""
    notes, settings = Notes(), TrackSettings(seed=job.seed, max_draws=job.max_draws)
    about: dict[str, Any] = {"person": person}
    try:
        tree = track(replace(job.source, person=person), settings, note=lambda message: notes.note(as_options(message))).result
        own = job.trial.rpartition("/")[2] + ("" if person == 1 else f"-person{person}")
        target = Path(job.folder) / job.trial / f"{own}.nc"
        target.parent.mkdir(parents=True, exist_ok=True)
        write_outputs(tree, target, notes.note)
        write_exports(tree, target, notes.note, model=job.source.model)
        row = about | row_of(tree, job.source.model) | {"file": target.relative_to(job.folder).as_posix()}
    except PosepplError as error:
        failed = {name: value for name, value in failure("", error).items() if name != "input"}
        return about | failed | {"notes": notes.said}, None, {}
    row["notes"] = [*notes.said, *row["notes"]]
    return row, variable(tree, "summary", "markers_mean"), {row["file"]: digest_of(target)}


def row_of(tree: Any, model: str | None = None) -> dict[str, Any]:
    """Summarise a smoothed result for the table.

    Args:
        tree: The result.
        model: Builder of its body, where that is not an installed one.
    """
    clock, errors, found = clock_of(tree), image_errors(tree), verdicts(tree)
    spread = variable(tree, "summary", "markers_sd")
    frames = len(clock.frames)
    row: dict[str, Any] = {
        "cameras": 0 if errors is None else len(errors.cameras),
        "frames": frames,
        "rate": clock.rate,
        "seconds": float(clock.times[-1] - clock.times[0]),
        "computing": float(tree.attrs.get("wall_seconds", np.nan)),
        "residual": np.nan if errors is None else float(np.nanmedian(errors.distance)),
        "worst": _worst_camera(errors),
        "deviation": np.nan if spread is None else float(np.median(spread)),
        "severity": found[0].severity,
        "verdict": found[0].worded(as_option),
        "warnings": sum(each.severity in ("warning", "error") for each in found),
        "notes": ["the frame rate is unknown: 30 frames a second are assumed"] if clock.assumed else [],
    }
    try:
        gait = gait_of(tree, model=model)
    except InputError as error:
        return row | {"gait": f"no walk: {error}"}
    measures: dict[str, list[Any]] = {}
    for name, side, unit, number, mean, lower, upper, _ in measure_rows(gait, LEVEL):
        measures[name if side == "both" else f"{name} {side}"] = [unit, int(number), mean, lower, upper]
    row["notes"] += gait.notes
    return row | {"gait": f"{sum(each.kind == 'strike' for each in gait.events)} heel strikes", "measures": measures}


def _worst_camera(errors: Any) -> str:
    """The camera of the largest median residual, px."""
    if errors is None:
        return ""
    sizes = np.array([np.nanmedian(own) if np.isfinite(own).any() else np.nan for own in np.moveaxis(errors.distance, 1, 0)])
    worst = int(np.nanargmax(sizes))
    return f"{errors.cameras[worst]} {sizes[worst]:.3g}"


_COLUMNS: Mapping[str, str] = {
    "person": "person",
    "people seen": "people seen",
    "cameras": "cameras",
    "frames": "frames",
    "rate": "rate (Hz)",
    "seconds": "duration (s)",
    "computing": "computing (s)",
    "residual": "median residual (px)",
    "worst": "camera of the largest residual (px)",
    "deviation": "median SD of joints (mm)",
    "severity": "severity",
    "verdict": "verdict",
    "warnings": "warnings",
    "gait": "gait",
}


def write_trials(records: Sequence[dict[str, Any]], passed_over: Iterable[tuple[Path, str]], folder: Path) -> list[str]:
    """Write ``table.csv`` and ``page.html``, and say what failed, and why."""
    rows = [row for record in records for row in _rows(record)]
    names = list(dict.fromkeys(name for row in rows for name in row.get("measures", {})))
    units = {name: own[0] for row in rows for name, own in row.get("measures", {}).items()}
    head = ["trial", *_COLUMNS.values()]
    head += [f"{name} {end}({units[name]})" for name in names for end in ("", "lower ", "upper ")] + ["file", "notes"]
    lines = []
    for row in rows:
        own = row.get("measures", {})
        measured = [_cell(value) for name in names for value in (own[name][2:] if name in own else [None] * 3)]
        cells = [_cell(row.get(name)) for name in ("trial", *_COLUMNS)]
        lines.append([*cells, *measured, row.get("file", ""), " | ".join(row.get("notes", []))])
    write_rows(folder / "table.csv", [head, *lines])
    write_atomically(folder / "page.html", trials_html(rows, [f"{where}: {why}" for where, why in passed_over], LEVEL))
    return [f"{row['trial']}: {row['error']}" for row in rows if "error" in row]


def _rows(record: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows of a trial; a trial that failed has one."""
    about = {"trial": record["input"], "people seen": record.get("people seen", np.nan)}
    rows = [about | row for row in record.get("rows", [{"error": record.get("error", "")}])]
    return [row | ({"severity": "failed", "verdict": row["error"]} if "error" in row else {}) for row in rows]


def _cell(value: Any) -> str:
    if value is None or value != value:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
