"""Arrays kept in a folder, one file a name, each with a record of what made them.

``NAME.npz`` contains the arrays and, as JSON, the record. Files are written whole or not at all. One that is damaged all the
same,
or has another record, counts as none, and that is reported: the caller computes it again. Nothing is pickled.

>>> from tempfile import mkdtemp
>>> store = Store(mkdtemp(), "results", note=print)
>>> store.save("seven", {"mean": 0.5}, {"version": 1})
>>> store.load("seven", {"version": 1})
{'mean': array(0.5)}
>>> store.load("eight", {"version": 1}) is None
True
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, InputError, cut
from poseppl.files.atomic_writing import atomic_path, remove_strays
from poseppl.files.numpy_arrays import SUFFIX, read_part, read_parts

Arrays = dict[str, NDArray[Any]]
Note = Callable[[str], None]
Record = Mapping[str, Any]
"""Values that JSON can represent."""
_RECORD = "__record__"
MAX_RECORD_BYTES = 2**24


def key_of(record: Record, arrays: Iterable[Any] = ()) -> str:
    """Hash what something is made from.

    Args:
        record: Plain values; their order does not matter.
        arrays: Arrays, or None where there is none; types, shapes, values and their order matter.

    Returns:
        64 hexadecimal digits.
    """
    digest = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
    for array in arrays:
        values = np.zeros(0, "V1") if array is None else np.ascontiguousarray(array)
        digest.update(f"{values.dtype}{values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


class Store:
    """A folder of arrays.

    Args:
        folder: The folder, made where it does not exist.
        what: The content, for messages.
        note: Called with a message about files that cannot be used.
        parents: Whether the folders around it are made, too.
        max_unpacked: Bytes that the arrays of one name may take, where files are compressed; None compresses nothing.

    Raises:
        InputError: The folder cannot be made.
    """

    def __init__(
        self, folder: FilePath, what: str, note: Note, *, parents: bool = True, max_unpacked: int | None = None
    ) -> None:
        self.folder, self._what, self._note = Path(folder), what, note
        self._max_unpacked = max_unpacked
        self._compression = zipfile.ZIP_STORED if max_unpacked is None else zipfile.ZIP_DEFLATED
        try:
            self.folder.mkdir(parents=parents, exist_ok=True)
        except OSError as error:
            expected = "a folder that can be written"
            raise InputError(f"no {what} can be kept there: {error.strerror}", file=folder, expected=expected) from error
        remove_strays(self.folder, "*", ".npz")

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.npz"

    def holds(self, name: str, record: Record) -> bool:
        """Whether there are arrays of a name with such a record; only the record is read, and nothing is reported.

        Args:
            name: Their name.
            record: The record that they must have.
        """
        try:
            with zipfile.ZipFile(self._path(name)) as archive:
                held = _record_of(archive)
            return all(held[field] == value for field, value in record.items())
        except Exception:  # there is none, or damaged bytes, which raise anything at all
            return False

    def load(
        self,
        name: str,
        record: Record,
        restore: Callable[[Arrays], Any] = lambda arrays: arrays,
        *,
        owners: Collection[str] = (),
        remedy: str = "computed again",
    ) -> Any:
        """Read arrays.

        Args:
            name: Their name.
            record: The record that they must have; other entries of their record do not matter.
            restore: Makes of the arrays what is returned; any error means that they are damaged.
            owners: Fields of the record in which a file must not differ: it is somebody else's, and must not be lost.
            remedy: The consequence of files that cannot be used, for messages.

        Returns:
            The restored arrays; None where nothing can be.

        Raises:
            InputError: The file is somebody else's.
        """
        path = self._path(name)
        if not path.exists():
            return None
        try:
            with zipfile.ZipFile(path) as archive:
                held = _record_of(archive)
                differing = {field: held[field] for field in record if held[field] != record[field]}
                restored = None if differing else restore(self._arrays(archive))
        except Exception as error:  # damaged bytes raise anything at all
            self._note(f"{path}: damaged ({cut(error, 200)}); {remedy}")
            return None
        for field in owners:
            if field in differing:
                problem = f"holds {self._what} of another {field}: {cut(json.dumps(differing[field]), 80)}"
                raise InputError(problem, file=path, expected="another folder")
        for field, value in list(differing.items())[:1]:
            self._note(f"{path}: of another {field} ({cut(json.dumps(value), 80)}); {remedy}")
        return restored

    def _arrays(self, archive: zipfile.ZipFile) -> Arrays:
        """The arrays, without the record; those of a store that compresses nothing take no more bytes than their file."""
        stored = Path(str(archive.filename)).stat().st_size
        arrays = read_parts(archive, stored if self._max_unpacked is None else self._max_unpacked)
        return {name: array for name, array in arrays.items() if name != _RECORD}

    def save(self, name: str, arrays: Mapping[str, Any], record: Record) -> None:
        """Write arrays, whole or not at all.

        Args:
            name: Their name.
            arrays: The arrays by name.
            record: The record of how they are made.

        Raises:
            InputError: The file cannot be written.
            PosepplError: The disk is full.
        """
        text = np.frombuffer(json.dumps(record).encode(), np.uint8)
        with atomic_path(self._path(name)) as path, zipfile.ZipFile(path, "w", self._compression, compresslevel=1) as file:
            for each, array in {**arrays, _RECORD: text}.items():
                with file.open(f"{each}{SUFFIX}", "w", force_zip64=True) as stream:
                    np.lib.format.write_array(stream, np.asarray(array), allow_pickle=False)


def _record_of(archive: zipfile.ZipFile) -> Any:
    return json.loads(read_part(archive, f"{_RECORD}{SUFFIX}", MAX_RECORD_BYTES).tobytes())
