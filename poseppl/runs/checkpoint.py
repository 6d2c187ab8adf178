"""Checkpoints of a run: a folder that a killed run is resumed from, bit for bit.

    settings.json          what the run is: settings, versions, a hash of data and inputs
    part-000000-000001.npz what was kept of frames 0 to 0, and the state after them
    part-000001-000009.npz ...

Parts are kept by a :class:`~poseppl.files.store.Store`, so that whatever kills the run leaves whole parts. A damaged part is
still recognised (arrays carry checksums in the zip, shapes and types are compared). It is computed again, with the parts that
follow it. Each part's record is a hash of the settings, so that damaged settings cost nothing. While a run is at the folder, it
holds a lock on it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import jax

from poseppl.errors import Argument, FilePath, Phrase, PosepplError, cut
from poseppl.files.atomic_writing import remove_strays, take_lock, write_atomically
from poseppl.files.store import Arrays, Note, Store, key_of

VERSION = 3


class CheckpointError(PosepplError):
    """A checkpoint that does not belong to this run."""


def fingerprint(data: Any, *, chunk: int, num_frames: int, state: Any, history: bool = False) -> dict[str, Any]:
    """Describe a run, so that a checkpoint of another one is recognised.

    Args:
        data: Observations, inputs and key, a pytree of arrays.
        chunk: Frames a part.
        num_frames: T.
        state: The filter's state, for its shapes.
        history: Whether the filter's history is kept.

    Returns:
        A value of types that JSON has.
    """
    shapes = [f"{leaf.dtype}{list(leaf.shape)}" for leaf in jax.tree.leaves(state)]
    return {
        "frames": num_frames,
        "chunk": chunk,
        "data, inputs and seed": key_of({}, jax.tree.leaves(data)),
        "state": shapes,
        "history": history,
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

    def __init__(self, folder: FilePath, settings: Mapping[str, Any] | None = None, *, resume: bool = False) -> None:
        self.folder = Path(folder)
        self.settings = json.loads(json.dumps(dict(settings or {})))
        self.resume = resume
        self._lock: int | None = None
        self._store: Store
        self._note: Note
        self._record: dict[str, str] = {}
        self._unsaved: dict[tuple[int, int], tuple[Any, Any]] = {}

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
            note: Receives messages about damaged settings and parts, and parts that cannot be written.

        Raises:
            CheckpointError: The folder holds another run, or this one and `resume` is not set, or a run is at it now.
            InputError: The folder cannot be made or read.
        """
        described = {"version": VERSION, **run, **self.settings}
        self._record = {"run": key_of(described)}
        self._note = note
        self._claim()
        path = self.folder / "settings.json"
        if path.exists():
            held = _held(path)
            if held is not None:
                self._compare(held, described)
                return
            aside = path.with_suffix(".damaged")
            path.replace(aside)
            note(f"{path}: damaged, and now called {aside.name}; the parts of this run are kept")
        elif any(self.folder.iterdir()):
            raise CheckpointError(f"{self.folder}: the folder contains other files; choose an empty folder for the checkpoint")
        write_atomically(path, json.dumps(described, indent=1) + "\n")

    def _claim(self) -> None:
        """Make the folder, lock it, and remove what killed runs have left half written."""
        self._store = Store(self.folder, "checkpoint", self._note, parents=False)
        try:
            self._lock = take_lock(self.folder)
        except BlockingIOError:
            problem = "another process is at this checkpoint; wait for its end, or choose another folder"
            raise CheckpointError(f"{self.folder}: {problem}") from None
        except OSError:  # a file system without locks
            pass
        remove_strays(self.folder, "*", ".*", min_age=0.0)

    def _compare(self, held: Mapping[str, Any], described: Mapping[str, Any]) -> None:
        differing = [name for name in {**held, **described} if held.get(name) != described.get(name)]
        if differing:
            shown = "; ".join(_difference(name, held.get(name), described.get(name)) for name in differing[:4])
            raise CheckpointError(
                f"{self.folder}: the checkpoint is of another run ({shown}); use the same settings and data, or another folder"
            )
        if not self.resume:
            resume = (
                f"{self.folder}: contains this run already; resume it (",
                Argument("resume"),
                "), or choose another folder",
            )
            raise CheckpointError(Phrase(*resume))

    def load(self, spans: Sequence[tuple[int, int]], state: Any, blank: Any) -> list[tuple[Any, Any]]:
        """Read the parts that are whole, from the first frame on.

        Args:
            spans: First frame and the one after the last, of each part.
            state: A state of the right shapes.
            blank: Output of the collector for one frame, of the right shapes.

        Returns:
            For each part the filter's state after it (None except for the last part) and the collector's output for its frames.
        """
        parts: list[tuple[Any, Any]] = []
        for start, stop in spans:
            remedy = f"frames from number {start} of the run on are computed again"
            restore = partial(_restored, frames=stop - start, state=state, blank=blank)
            part = self._store.load(_name(start, stop), self._record, restore, remedy=remedy)
            if part is None:
                break
            parts.append(part)
        return [(None, kept) for _, kept in parts[:-1]] + parts[-1:]

    def save(self, start: int, stop: int, state: Any, kept: Any) -> None:
        """Write a part, whole or not at all; one that cannot be written is tried again with the next.

        Args:
            start: The first frame.
            stop: The one after the last.
            state: The filter's state after the part.
            kept: The collector's output for its frames.
        """
        waiting = bool(self._unsaved)
        self._unsaved[start, stop] = state, kept
        try:
            for span in list(self._unsaved):
                self._write(span, *self._unsaved[span])
                del self._unsaved[span]
        except (OSError, PosepplError) as error:
            if not waiting:
                self._note(f"{error}; the run continues, its frames from number {start} on are not saved yet")

    def _write(self, span: tuple[int, int], state: Any, kept: Any) -> None:
        arrays = {f"kept_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(kept))}
        arrays |= {f"state_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(state))}
        self._store.save(_name(*span), arrays, self._record)


def _name(start: int, stop: int) -> str:
    return f"part-{start:06d}-{stop:06d}"


def _held(path: Path) -> dict[str, Any] | None:
    """The settings that a file holds; None where it is damaged."""
    try:
        held = json.loads(path.read_bytes())
    except Exception:  # damaged bytes raise anything at all
        return None
    return held if isinstance(held, dict) else None


def _restored(arrays: Arrays, frames: int, state: Any, blank: Any) -> tuple[Any, Any]:
    def restore(prefix: str, example: Any, leading: tuple[int, ...]) -> Any:
        leaves, tree = jax.tree.flatten(example)
        found = [arrays[f"{prefix}_{i}"] for i in range(len(leaves))]
        for array, leaf in zip(found, leaves, strict=True):
            if array.shape != (*leading, *leaf.shape) or array.dtype != leaf.dtype:
                raise ValueError(f"an array of {array.dtype}{array.shape} where {leaf.dtype}{(*leading, *leaf.shape)} belongs")
        return jax.tree.unflatten(tree, found)

    return restore("state", state, ()), restore("kept", blank, (frames,))


def _difference(name: str, held: Any, wanted: Any) -> str:
    if name == "data, inputs and seed":
        return "other data, inputs or seed"
    return f"{name}: {cut(json.dumps(held), 60)} there, {cut(json.dumps(wanted), 60)} here"
