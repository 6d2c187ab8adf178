"""The files in which a result goes to other programs, by format: how their names end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from poseppl.errors import Argument, FilePath, InputError, brief

ENDS = {
    "trc": (".trc", "_lower.trc", "_upper.trc"),
    "mot": (".mot",),
    "osim": (".osim",),
    "bvh": (".bvh",),
    "c3d": (".c3d",),
    "csv": (".csv",),
    "rrd": (".rrd",),
}


def files_of(folder: FilePath, stem: str, formats: Sequence[str]) -> dict[str, list[Path]]:
    """The files of each format.

    Raises:
        InputError: A format is unknown.
    """
    for name in formats:
        if name not in ENDS:
            raise InputError(brief(name), field=Argument("format"), expected=", ".join(ENDS))
    return {name: [Path(folder) / f"{stem}{end}" for end in ENDS[name]] for name in formats}
