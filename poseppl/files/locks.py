"""Locks of files and folders between processes.

A lock belongs to an open descriptor (``flock``), so that a process that ends, by whatever signal, lets go of it: there is
nothing stale to clear.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


def take_lock(path: Path) -> int:
    """Lock a file or a folder that exists.

    Args:
        path: The file or folder.

    Returns:
        A descriptor; to close it lets go.

    Raises:
        BlockingIOError: It is locked already.
        OSError: It cannot be opened, or its file system knows no locks.
    """
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
