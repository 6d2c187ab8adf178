"""Recordings of experiments, identified by the content of their files."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from poseppl.errors import FilePath
from poseppl.files.bounded_reading import read_bytes


@dataclass(frozen=True)
class Recording:
    """A motion to look at; the built-in walk where ``path`` is None.

    Attributes:
        name: Name in tables.
        path: The recording, as :func:`poseppl.motion.io.read_motion` reads it, or a folder of pictures.
        skeleton: Its skeleton, where the format has one apart.
        digest: Hash of both, so that results of another file are not taken for its own.
    """

    name: str
    path: str | None = None
    skeleton: str | None = None
    digest: str = ""

    @classmethod
    def of_file(cls, name: str, path: FilePath, skeleton: FilePath | None = None) -> Recording:
        """Name a file, or a folder, which is known by all of its files.

        Raises:
            InputError: It cannot be read.
        """
        digest = hashlib.sha256()
        given = [Path(each).resolve() for each in (path, skeleton) if each is not None]
        for each in given:
            for file in sorted(each.rglob("*.*")) if each.is_dir() else [each]:
                digest.update(read_bytes(file, max_bytes=2**28))
        return cls(name, str(given[0]), str(given[1]) if len(given) > 1 else None, digest.hexdigest()[:16])

    @property
    def description(self) -> str:
        """The name, and that of the file."""
        return f"{self.name} ({Path(self.path).name})" if self.path else self.name

    @property
    def option(self) -> str:
        """The option of the command line that names it, with the names of the files alone; empty for the built-in walk."""
        files = ",".join(Path(file).name for file in (self.path, self.skeleton) if file)
        return f"--motion {self.name}={files}" if files else ""


BUILT_IN = Recording("built-in walk")
