"""The user's folder for what is costly to make and can be made again."""

from __future__ import annotations

import os
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory


def cache_folder(name: str) -> Path:
    """The folder of that name in ``$XDG_CACHE_HOME/poseppl``, by default ``~/.cache/poseppl``; it need not exist."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "poseppl" / name


def xla_folder() -> Path:
    """The folder of XLA's cache: the one that the environment names, or that of this version of poseppl."""
    return Path(os.environ.get("JAX_COMPILATION_CACHE_DIR") or cache_folder("xla") / version("poseppl"))


def ensure_home() -> None:
    """Give a user without a home folder an empty one, until this process ends: ArviZ and others cannot be imported without."""
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = _temporary_home().name


@cache
def _temporary_home() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="poseppl-home-")
