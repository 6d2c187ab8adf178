"""Decimal numbers of text files, by one rule for all readers."""

from __future__ import annotations

import re

MAX_LETTERS = 64
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)


def decimal_number(word: str) -> float | None:
    """The number that a word stands for, infinite beyond the range of float64; None if it is no number.

    Python's ``float`` also takes "nan", "infinity", "1_000" and the digits of other scripts.

    >>> decimal_number("-1.5e3"), decimal_number("1_000"), decimal_number("inf")
    (-1500.0, None, None)
    """
    return float(word) if len(word) <= MAX_LETTERS and _NUMBER.fullmatch(word) else None
