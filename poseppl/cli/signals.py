"""Signals that ask a process to end: they interrupt a command as Ctrl-C does, so that it tidies up and says how to go on."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


class Terminated(KeyboardInterrupt):
    """A signal other than that of Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextmanager
def signals_interrupt() -> Iterator[None]:
    """Raise :class:`Terminated` at such signals while the block runs, where nobody else has asked for them."""
    caught = [number for number in _SIGNALS if signal.getsignal(number) is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        caught = []
    for number in caught:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number in caught:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def signals_set(event: threading.Event) -> Iterator[None]:
    """Set an event at the first of such signals, or at Ctrl-C, while the block runs; the next one does as before."""
    numbers = (signal.SIGINT, *_SIGNALS) if threading.current_thread() is threading.main_thread() else ()
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: handler for number, handler in before.items() if callable(handler)}

    def on_signal(number: int, frame: FrameType | None) -> None:
        event.set()
        signal.signal(number, before[signal.Signals(number)])

    for number in before:
        signal.signal(number, on_signal)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def signal_of(error: BaseException) -> int:
    """The number of the signal that interrupted a command; click raises an error of its own from ours."""
    origin = error if isinstance(error, Terminated) else error.__cause__
    return origin.number if isinstance(origin, Terminated) else int(signal.SIGINT)


def end_by_signal(number: int) -> None:
    """End the process by the signal that asked for it, as its parent expects; Ctrl-C ends a command by its exit status."""
    if number != signal.SIGINT:
        sys.stdout.flush()
        os.kill(os.getpid(), number)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise Terminated(number)
