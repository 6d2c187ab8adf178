"""Waiting for what another process, thread or browser does, however slow the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable
from subprocess import Popen
from typing import Any

PATIENCE = 1800.0
"""Seconds after which a test gives up on what never comes: longer than any loaded machine needs."""
_POLL = 0.02


def wait_until(condition: Callable[[], Any], *, process: Popen[Any] | None = None) -> None:
    """Return once a condition holds.

    Args:
        condition: It is asked every 20 ms.
        process: Process that makes it true; if it ends before, waiting ends.

    Raises:
        AssertionError: The process has ended, or patience has.
    """
    began = time.monotonic()
    while not condition():
        if process is not None and process.poll() is not None and not condition():  # it may have done so just before its end
            raise AssertionError(f"the process ended before it did what is waited for: {_end_of(process)}")
        if time.monotonic() - began > PATIENCE:
            raise AssertionError(f"what is waited for has not come in {PATIENCE:g} seconds")
        time.sleep(_POLL)


def _end_of(process: Popen[Any]) -> str:
    """Status of a process that has ended, and what it wrote into pipes."""
    written = [text if isinstance(text, str) else text.decode(errors="replace") for text in process.communicate() if text]
    return "\n".join([f"status {process.returncode}", *written])
