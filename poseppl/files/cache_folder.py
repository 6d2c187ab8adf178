"""The user's folder for what is costly to make and can be made again."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory


def cache_folder(name: str) -> Path:
    """The folder of that name in ``$XDG_CACHE_HOME/poseppl``, by default ``~/.cache/poseppl``; it need not exist."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "poseppl" / name


def ensure_home() -> None:
    """Give a user without a home folder an empty one, until this process ends: ArviZ and others cannot be imported without."""
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = _temporary_home().name


@cache
def _temporary_home() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="poseppl-home-")
