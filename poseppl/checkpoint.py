"""Checkpoints of a run: a folder that a killed run is resumed from, bit for bit.

    settings.json          what the run is: settings, versions, a hash of data and inputs
    part-000000-000001.npz what was kept of frames 0 to 0, and the state after them
    part-000001-000009.npz ...

Every file is written under another name, flushed and moved into place, so that whatever kills the run leaves whole parts; a
part that is damaged all the same is recognised (arrays carry checksums in the zip, shapes and types are compared), and it and
what follows it are computed anew. Nothing is pickled.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from poseppl.errors import InputError, PosepplError
from poseppl.io.files import atomic_path

VERSION = 1


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
    """A checkpoint folder.

    Args:
        folder: The folder; made if it does not exist, its parent must.
        settings: Whatever else decides the result (model, filter, settings), as JSON can hold it.
        resume: Continue the run that the folder holds; without it, a folder that holds one is refused.
    """

    def __init__(self, folder: str | PathLike[str], settings: Mapping[str, Any] | None = None, *, resume: bool = False) -> None:
        self.folder = Path(folder)
        self.settings = json.loads(json.dumps(dict(settings or {})))
        self.resume = resume

    def open(self, run: Mapping[str, Any]) -> None:
        """Claim the folder for a run, or check that it holds this one.

        Args:
            run: The run's :func:`fingerprint`.

        Raises:
            CheckpointError: The folder holds another run, or this one and `resume` is not set.
            InputError: The folder cannot be made or read.
        """
        described = {"version": VERSION, **run, **self.settings}
        path = self.folder / "settings.json"
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            expected = "a folder that can be written"
            raise InputError(
                f"no checkpoint can be kept there: {error.strerror}", file=self.folder, expected=expected
            ) from error
        if path.exists():
            self._compare(path, described)
        elif any(self.folder.iterdir()):
            raise CheckpointError(f"{self.folder}: the folder holds other files; name an empty folder for the checkpoint")
        else:
            with atomic_path(path) as temporary:
                temporary.write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")

    def _compare(self, path: Path, described: Mapping[str, Any]) -> None:
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise CheckpointError(f"{path}: unreadable; remove the folder to start anew") from error
        held = held if isinstance(held, dict) else {}
        differing = [name for name in {**held, **described} if held.get(name) != described.get(name)]
        if differing:
            shown = "; ".join(_difference(name, held.get(name), described.get(name)) for name in differing[:4])
            raise CheckpointError(
                f"{self.folder}: the checkpoint is of another run ({shown}); use the same settings and data, or another folder"
            )
        if not self.resume:
            raise CheckpointError(f"{self.folder}: holds this run already; resume it (--resume), or name another folder")

    def load(self, spans: Sequence[tuple[int, int]], state: Any, blank: Any, note: Callable[[str], None]) -> list[Part]:
        """Read the parts that are whole, from the first frame on.

        Args:
            spans: First frame and the one after the last, of each part.
            state: A state of the right shapes.
            blank: What is kept of one frame, of the right shapes.
            note: Is told of damaged parts.
        """
        for stray in self.folder.glob(".*.tmp.*"):
            stray.unlink(missing_ok=True)
        parts: list[Part] = []
        for start, stop in spans:
            path = self._path(start, stop)
            if not path.exists():
                break
            try:
                parts.append(_read(path, stop - start, state, blank))
            except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError, NotImplementedError) as error:
                note(f"{path}: damaged ({error}); frames from number {start} of the run on are computed anew")
                break
        return [part._replace(state=None) for part in parts[:-1]] + parts[-1:]

    def save(self, start: int, stop: int, part: Part) -> None:
        """Write a part, whole or not at all."""
        arrays = {f"kept_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(part.kept))}
        arrays |= {f"state_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(part.state))}
        with atomic_path(self._path(start, stop)) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **arrays)

    def _path(self, start: int, stop: int) -> Path:
        return self.folder / f"part-{start:06d}-{stop:06d}.npz"


def _read(path: Path, frames: int, state: Any, blank: Any) -> Part:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}

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
