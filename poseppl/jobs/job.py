"""A computation as plain values, the key and the versions that identify a job, and executors, plainest of all this process.

>>> from dataclasses import dataclass
>>> @dataclass(frozen=True)
... class Estimate(Job):
...     method: str
...     run: int
...     @property
...     def name(self) -> str:
...         return f"{self.method}-{self.run:02}"
>>> Estimate("hmc", 7).key.startswith("hmc-07-")
True
>>> Estimate("hmc", 7).key == Estimate("hmc", 7).key != Estimate("hmc", 8).key
True

An executor yields one :class:`Outcome` for each job, in any order. It keeps nothing and writes nothing; outcomes are kept by
key, so that a job that was computed twice, because a worker was lost, still counts once.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import re
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from poseppl.files.store import Arrays, Note, key_of

_LATER = "later"


def later_field(default: Any) -> Any:
    """A field that a dataclass got when results of it were kept already: at its default it does not distinguish jobs."""
    return field(default=default, metadata={_LATER: True})


def plain_fields(value: Any) -> Any:
    """Dataclasses within a value as mappings of their fields, without those of :func:`later_field` at their default."""
    if is_dataclass(value) and not isinstance(value, type):
        entries = [(each, getattr(value, each.name)) for each in fields(value)]
        return {each.name: plain_fields(own) for each, own in entries if not (_LATER in each.metadata and own == each.default)}
    if isinstance(value, Mapping):
        return {key: plain_fields(each) for key, each in value.items()}
    return [plain_fields(each) for each in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True)
class Job:
    """One piece of work; subclass it as a frozen dataclass whose fields are plain values.

    Numbers, texts, booleans, None, and tuples, lists, mappings and dataclasses of them. A job is at the top level of a module,
    as the function that computes it is: other processes import both.

    Attributes:
        version: Raise it when the same fields mean another result; results of other versions have other keys.
    """

    version: ClassVar[int] = 1

    def __init_subclass__(cls) -> None:
        clashing = sorted({"name", "cost", "contents", "key"} & set(inspect.get_annotations(cls)))
        if clashing:
            raise TypeError(f"{cls.__name__}: a job has {clashing[0]} already. Give the field another name.")

    @property
    def name(self) -> str:
        """A short name to read; it need not be unique."""
        return type(self).__name__.lower()

    @property
    def cost(self) -> float:
        """How long it takes, relative to the other jobs; positive."""
        return 1.0

    @property
    def contents(self) -> dict[str, Any]:
        """Class, version and fields, as JSON.

        Raises:
            ValueError: A field is not of plain values.
        """
        kind = type(self)
        try:
            entries = json.loads(json.dumps(plain_fields(self)))
        except TypeError as error:
            raise ValueError(f"{kind.__name__}: {error}. The fields of a job are numbers, texts and lists of them.") from error
        return {"class": f"{kind.__module__}.{kind.__qualname__}", "version": kind.version, "fields": entries}

    @property
    def key(self) -> str:
        """The name and a hash of the contents: the name of its file."""
        readable = re.sub(r"[^A-Za-z0-9._=+-]+", "-", self.name)[:80].strip(".-") or "job"
        return f"{readable}-{key_of(self.contents)[:16]}"


Function = Callable[[Any], Mapping[str, Any]]
"""`job -> {name: array}`, at the top level of a module."""


class Outcome(NamedTuple):
    """Outcome of one job.

    Attributes:
        key: The job's.
        arrays: Its result; None when it failed.
        seconds: How long it took.
        error: Why it failed, in a line; empty when it did not.
        trace: The place of the failure.
    """

    key: str
    arrays: Arrays | None
    seconds: float = 0.0
    error: str = ""
    trace: str = ""


class Executor(Protocol):
    """Computes jobs."""

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Generator[Outcome]:
        """Compute jobs; closing the iterator stops what is still running.

        Args:
            function: The function that computes a job.
            jobs: Jobs by key, the costliest first.
            note: Called with messages for the user.

        Yields:
            One outcome for each job.
        """


class Inline:
    """Computes jobs one after the other in this process."""

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Generator[Outcome]:
        """See :class:`Executor`."""
        for key, job in jobs.items():
            yield perform(key, function, job)


def perform(key: str, function: Function, job: Job) -> Outcome:
    """Compute one job in this process; an exception becomes a part of the outcome."""
    start = time.perf_counter()
    try:
        arrays = _plain(function(job))
    except (Exception, SystemExit) as error:
        line = " ".join("".join(traceback.format_exception_only(error)).split())
        return Outcome(key, None, time.perf_counter() - start, line, "".join(traceback.format_exception(error)))
    return Outcome(key, arrays, time.perf_counter() - start)


def _plain(result: Mapping[str, Any]) -> Arrays:
    arrays = {str(name): np.asarray(value) for name, value in result.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in "biufcSUmM":
            raise ValueError(f"the result {name!r} is of type {array.dtype}, which a file cannot hold")
    return arrays


_PACKAGES = ("poseppl", "jax", "jaxlib", "numpyro", "blackjax", "numpy")
_SOURCES = ("poseppl", "poseppl_models", "poseppl_papers")
_NOT_IN_RESULTS = ("cli", "report")
"""Folders of poseppl whose code decides no result of a job."""


@cache
def versions() -> dict[str, str]:
    """Versions by the name of the package; poseppl's ends with the first digits of :func:`source_hash`."""
    found = {name: version(name) for name in _PACKAGES}
    return found | {"poseppl": f"{found['poseppl']}+{source_hash(_folders())[:12]}"}


def source_hash(folders: Iterable[Path]) -> str:
    """Hash the Python files and data files of packages, without those that decide no result.

    Args:
        folders: Those of the packages.

    Returns:
        64 hexadecimal digits, which do not depend on where the folders are.
    """
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            parts = file.relative_to(folder).parts
            if file.suffix in (".py", ".json") and parts[0] not in _NOT_IN_RESULTS:
                content = file.read_bytes()
                digest.update(f"{folder.name}/{'/'.join(parts)} {len(content)}\n".encode())
                digest.update(content)
    return digest.hexdigest()


def _folders() -> list[Path]:
    places = [spec.submodule_search_locations for name in _SOURCES if (spec := find_spec(name)) is not None]
    return [Path(place) for found in places for place in found or ()]
