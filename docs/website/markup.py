"""Plain text as reStructuredText."""

from __future__ import annotations

import re

_CODE = re.compile(r"(:[\w:]+:`[^`]*`|``.*?``|`[^`]*`)")


def plain(text: str) -> str:
    """A line of text whose bars, stars and final underscores stand for themselves; code is left alone."""
    parts = _CODE.split(text)
    parts[::2] = [re.sub(r"(?<=\w)_(?!\w)", r"\\_", re.sub(r"(?<!\\)([|*])", r"\\\1", part)) for part in parts[::2]]
    return "".join(parts)
