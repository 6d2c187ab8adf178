"""Docstrings as reStructuredText: they are plain text; their formulae would be read as marks.

An indented block after a paragraph is a formula or a table and is shown as it stands; bars and stars in the text are no marks.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from website.algorithms import glance
from website.markup import plain

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_SECTION = re.compile(r"\s*(Args|Arguments|Attributes|Example|Examples|Note|Notes|Raises|Returns|Yields|Warning|Warns):")
_NO_PARAGRAPH = re.compile(r"\s*([-*+] |\d+\. |\.\. |:\w+:)|.*::$")


def marked_up(lines: Sequence[str]) -> list[str]:
    r"""The lines of a docstring, with its formulae marked as such.

    >>> marked_up(["The sum of |x|,", "", "    |x_1| + |x_2|", "", "and so on."])
    ['The sum of \\|x\\|,', '', '.. code-block:: none', '', '    |x_1| + |x_2|', '', 'and so on.']
    """
    found: list[str] = []
    literal: int | None = None
    before = ""
    for number, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if not line.strip():
            found.append(line)
            continue
        if literal is not None and indent < literal:
            literal = None
        follows = number > 0 and not lines[number - 1].strip() and bool(before)
        if literal is None and follows and indent >= 4 and _starts_formula(before, line):
            found += [" " * (len(before) - len(before.lstrip())) + ".. code-block:: none", ""]
            literal = indent
        bullet = re.match(r"\s*[-*+] ", line)
        start = bullet.end() if bullet else 0
        is_code = literal is not None or line.lstrip().startswith((">>>", "...", ".. "))
        found.append(line if is_code else line[:start] + plain(line[start:]))
        before = line
    return found


def _starts_formula(before: str, line: str) -> bool:
    """Whether an indented line after a blank one begins a block that is shown as it stands."""
    deeper = len(line) - len(line.lstrip()) > len(before) - len(before.lstrip())
    return deeper and not (_SECTION.match(before) or _NO_PARAGRAPH.match(before) or line.lstrip().startswith(">>>"))


def _process(app: Sphinx, what: str, name: str, documented: Any, options: Any, lines: list[str]) -> None:
    lines[:] = marked_up(lines)
    if what == "module":
        lines += ["", *glance(name)]


def _skip(app: Sphinx, what: str, name: str, documented: Any, skip: bool, options: Any) -> bool | None:
    """Leave out fields of tuples, which `Attributes` describes, and methods that other libraries add to our classes."""
    foreign = callable(documented) and not str(getattr(documented, "__module__", "poseppl")).startswith("poseppl")
    return True if type(documented).__name__ == "_tuplegetter" or (foreign and what == "class") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx, before Napoleon."""
    app.connect("autodoc-process-docstring", _process, priority=400)
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
