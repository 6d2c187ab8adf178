"""Results of jobs in a folder: ``KEY.npz`` holds the arrays of one job and, as JSON, what the job was.

Files are written whole or not at all. One that is damaged all the same, or that other versions of the libraries computed, is
computed anew; one that holds another job is left alone and refused.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.errors import InputError
from poseppl.experiments.jobs.executor import Arrays, Function, Note
from poseppl.experiments.jobs.job import Job
from poseppl.files.atomic_writing import atomic_path, remove_strays

FORMAT = 1
_RECORD = "__job__"
_PACKAGES = ("poseppl", "jax", "jaxlib", "numpyro", "blackjax", "numpy")


@cache
def versions() -> dict[str, str]:
    """Versions of the libraries that decide a result."""
    return {name: version(name) for name in _PACKAGES}


class Archive:
    """The folder of one function's results.

    Args:
        folder: The folder; made where it does not exist.
        function: What computes the jobs.
        note: Is told of files that are computed anew.

    Raises:
        InputError: The folder cannot be made.
    """

    def __init__(self, folder: str | PathLike[str], function: Function, note: Note) -> None:
        self.folder = Path(folder)
        self.note = note
        self._function = f"{function.__module__}.{function.__qualname__}"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            expected = "a folder that can be written"
            raise InputError(f"no results can be kept there: {error.strerror}", file=folder, expected=expected) from error
        remove_strays(self.folder, "*", ".npz")

    def path(self, job: Job) -> Path:
        """The file of a job."""
        return self.folder / f"{job.key}.npz"

    def load(self, job: Job) -> Arrays | None:
        """Read a job's result.

        Returns:
            The arrays; None where there are none that can be used.

        Raises:
            InputError: The file holds another job.
        """
        path = self.path(job)
        if not path.exists():
            return None
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            record = json.loads(arrays.pop(_RECORD).tobytes())
            held = {name: record[name] for name in ("format", "versions", "job", "function")}
        except Exception as error:  # damaged bytes raise anything at all
            self.note(f"{path}: damaged ({error}); computed anew")
            return None
        return arrays if self._usable(path, held, self._record(job)) else None

    def _usable(self, path: Path, held: dict[str, Any], wanted: dict[str, Any]) -> bool:
        if held["job"] != wanted["job"] or held["function"] != wanted["function"]:
            raise InputError(f"holds a result of {held['function']} for another job", file=path, expected="another folder")
        differing = [name for name in ("format", "versions") if held[name] != wanted[name]]
        if differing:
            self.note(f"{path}: of {differing[0]} {held[differing[0]]}; computed anew")
        return not differing

    def save(self, job: Job, arrays: Arrays, seconds: float) -> None:
        """Write a job's result, whole or not at all."""
        text = json.dumps({**self._record(job), "seconds": seconds})
        record = np.frombuffer(text.encode(), np.uint8)
        with atomic_path(self.path(job)) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **{**arrays, _RECORD: record})  # type: ignore[arg-type]

    def _record(self, job: Job) -> dict[str, Any]:
        return {"format": FORMAT, "versions": versions(), "job": job.contents, "function": self._function}
