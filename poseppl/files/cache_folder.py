"""The user's folder for what is costly to make and can be made again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder(name: str) -> Path:
    """The folder of that name in ``$XDG_CACHE_HOME/poseppl``, by default ``~/.cache/poseppl``; it need not exist."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "poseppl" / name
