"""Checkpoints of a run: a folder that a killed run is resumed from, bit for bit.

    settings.json          what the run is: settings, versions, a hash of data and inputs
    part-000000-000001.npz what was kept of frames 0 to 0, and the state after them
    part-000001-000009.npz ...

Every file is written under another name, flushed and moved into place, so that whatever kills the run leaves whole parts; a
part that is damaged all the same is recognised (arrays carry checksums in the zip, shapes and types are compared), and it and
what follows it are computed anew. Each part carries a hash of the settings, so that damaged settings cost nothing. While a run
is at the folder, it holds a lock on it. Nothing is pickled.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError, PosepplError
from poseppl.files.atomic_writing import atomic_path, remove_strays
from poseppl.files.locks import take_lock

VERSION = 2
Note = Callable[[str], None]


class CheckpointError(PosepplError):
    """A checkpoint that does not belong to this run."""


class Part(NamedTuple):
    """Frames that were done: what was kept of them, with a leading axis of frames, and the filter's state after them."""

    kept: Any
    state: Any


def fingerprint(data: Any, *, chunk: int, num_frames: int, state: Any) -> dict[str, Any]:
    """Describe a run, so that a checkpoint of another one is recognised.

    Args:
        data: Observations, inputs and key, a pytree of arrays.
        chunk: Frames a part.
        num_frames: T.
        state: The filter's state, for its shapes.

    Returns:
        What JSON can hold.
    """
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(data):
        array = np.ascontiguousarray(leaf)
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(array.tobytes())
    shapes = [f"{leaf.dtype}{list(leaf.shape)}" for leaf in jax.tree.leaves(state)]
    return {
        "frames": num_frames,
        "chunk": chunk,
        "data, inputs and seed": digest.hexdigest(),
        "state": shapes,
        "jax": jax.__version__,
        "device": jax.default_backend(),
    }


class Checkpoint:
    """A checkpoint folder; a context, at whose end its lock is let go.

    Args:
        folder: The folder; made if it does not exist, its parent must.
        settings: Whatever else decides the result (model, filter, settings), as JSON can hold it.
        resume: Continue the run that the folder holds; without it, a folder that holds one is refused.
    """

    def __init__(self, folder: str | PathLike[str], settings: Mapping[str, Any] | None = None, *, resume: bool = False) -> None:
        self.folder = Path(folder)
        self.settings = json.loads(json.dumps(dict(settings or {})))
        self.resume = resume
        self._lock: int | None = None
        self._digest = np.zeros(0, np.uint8)
        self._unsaved: dict[tuple[int, int], Part] = {}

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def open(self, run: Mapping[str, Any], note: Note) -> None:
        """Claim the folder for a run, or check that it holds this one.

        Args:
            run: The run's :func:`fingerprint`.
            note: Is told of damaged settings.

        Raises:
            CheckpointError: The folder holds another run, or this one and `resume` is not set, or a run is at it now.
            InputError: The folder cannot be made or read.
        """
        described = {"version": VERSION, **run, **self.settings}
        text = json.dumps(described, indent=1) + "\n"
        self._digest = np.frombuffer(hashlib.sha256(text.encode()).digest(), np.uint8)
        self._claim()
        path = self.folder / "settings.json"
        if path.exists():
            held = _held(path)
            if held is not None:
                self._compare(held, described)
                return
            aside = path.with_suffix(".damaged")
            path.replace(aside)
            note(f"{path}: damaged, and now called {aside.name}; the parts that are of this run are kept")
        elif any(self.folder.iterdir()):
            raise CheckpointError(f"{self.folder}: the folder holds other files; name an empty folder for the checkpoint")
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def _claim(self) -> None:
        """Make the folder, lock it, and remove what killed runs have left half written."""
        try:
            self.folder.mkdir(exist_ok=True)
            self._lock = take_lock(self.folder)
        except BlockingIOError:
            problem = "another process is at this checkpoint; wait for its end, or name another folder"
            raise CheckpointError(f"{self.folder}: {problem}") from None
        except OSError as error:
            if not self.folder.is_dir():
                expected = "a folder that can be written"
                raise InputError(
                    f"no checkpoint can be kept there: {error.strerror}", file=self.folder, expected=expected
                ) from error
        for stem, suffix in (("settings", ".json"), ("part-*", ".npz")):
            remove_strays(self.folder, stem, suffix, min_age=0.0)

    def _compare(self, held: Mapping[str, Any], described: Mapping[str, Any]) -> None:
        differing = [name for name in {**held, **described} if held.get(name) != described.get(name)]
        if differing:
            shown = "; ".join(_difference(name, held.get(name), described.get(name)) for name in differing[:4])
            raise CheckpointError(
                f"{self.folder}: the checkpoint is of another run ({shown}); use the same settings and data, or another folder"
            )
        if not self.resume:
            raise CheckpointError(f"{self.folder}: holds this run already; resume it (--resume), or name another folder")

    def load(self, spans: Sequence[tuple[int, int]], state: Any, blank: Any, note: Note) -> list[Part]:
        """Read the parts that are whole, from the first frame on.

        Args:
            spans: First frame and the one after the last, of each part.
            state: A state of the right shapes.
            blank: What is kept of one frame, of the right shapes.
            note: Is told of damaged parts.
        """
        parts: list[Part] = []
        for start, stop in spans:
            path = self._path(start, stop)
            if not path.exists():
                break
            try:
                parts.append(_read(path, stop - start, state, blank, self._digest))
            except Exception as error:  # damaged bytes raise anything at all
                note(f"{path}: damaged ({error}); frames from number {start} of the run on are computed anew")
                break
        return [part._replace(state=None) for part in parts[:-1]] + parts[-1:]

    def save(self, start: int, stop: int, part: Part, note: Note) -> None:
        """Write a part, whole or not at all; one that cannot be written is tried again with the next.

        Args:
            start: The first frame.
            stop: The one after the last.
            part: The part.
            note: Is told when parts cannot be written.
        """
        waiting = bool(self._unsaved)
        self._unsaved[start, stop] = part
        try:
            for span in list(self._unsaved):
                self._write(span, self._unsaved[span])
                del self._unsaved[span]
        except (OSError, PosepplError) as error:
            if not waiting:
                note(f"{error}; the run goes on, its frames from number {start} on are not saved yet")

    def _write(self, span: tuple[int, int], part: Part) -> None:
        arrays = {f"kept_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(part.kept))}
        arrays |= {f"state_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(part.state))}
        with atomic_path(self._path(*span)) as temporary, temporary.open("wb") as stream:
            np.savez(stream, run=self._digest, **arrays)

    def _path(self, start: int, stop: int) -> Path:
        return self.folder / f"part-{start:06d}-{stop:06d}.npz"


def _held(path: Path) -> dict[str, Any] | None:
    """The settings that a file holds; None where it is damaged."""
    try:
        held = json.loads(path.read_bytes())
    except Exception:  # damaged bytes raise anything at all
        return None
    return held if isinstance(held, dict) else None


def _read(path: Path, frames: int, state: Any, blank: Any, digest: NDArray[np.uint8]) -> Part:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    if not np.array_equal(arrays["run"], digest):
        raise ValueError("a part of another run")

    def restore(prefix: str, example: Any, leading: tuple[int, ...]) -> Any:
        leaves, tree = jax.tree.flatten(example)
        found = [arrays[f"{prefix}_{i}"] for i in range(len(leaves))]
        for array, leaf in zip(found, leaves, strict=True):
            if array.shape != (*leading, *leaf.shape) or array.dtype != leaf.dtype:
                raise ValueError(f"an array of {array.dtype}{array.shape} where {leaf.dtype}{(*leading, *leaf.shape)} belongs")
        return jax.tree.unflatten(tree, found)

    return Part(restore("kept", blank, (frames,)), restore("state", state, ()))


def _difference(name: str, held: Any, wanted: Any) -> str:
    if name == "data, inputs and seed":
        return "other data, inputs or seed"
    return f"{name}: {json.dumps(held)[:60]} there, {json.dumps(wanted)[:60]} here"
