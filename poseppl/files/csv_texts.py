"""Texts in CSV files that spreadsheets would run.

A spreadsheet takes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a line end for a formula, which may call
programs and servers. A name from a file of somebody else's may be one. An apostrophe before it makes a text of it.
"""

from __future__ import annotations

import re
from typing import Any

from poseppl.files.decimal_numbers import decimal_number

_FORMULA = re.compile("'*[=+\\-@\t\n\uff1d\uff0b\uff0d\uff20]")  # the last four are those of full width


def shielded(cell: Any) -> Any:
    """A cell as CSV files have it: an apostrophe before a text that begins as a formula; numbers are not changed.

    A carriage return, at which Python's writer does not quote a text, and a spreadsheet begins a row, becomes a newline.

    >>> shielded("=1+1"), shielded("-1.5"), shielded(-1.5), shielded("hip")
    ("'=1+1", '-1.5', -1.5, 'hip')
    """
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r", "\n")
    formula = _FORMULA.match(text) and text != "-inf" and decimal_number(text) is None
    return f"'{text}" if formula else text


def unshielded(word: str) -> str:
    """The text that :func:`shielded` wrote.

    >>> unshielded(shielded("=1+1")), unshielded(shielded("'=1")), unshielded("'hip'")
    ('=1+1', "'=1", "'hip'")
    """
    return word[1:] if word.startswith("'") and _FORMULA.match(word) else word
