"""Print what the pages say between their marks, or write it: python docs/verdicts [--write]."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])

from verdicts.pages import DOCS, SECTIONS, made, read_tables  # noqa: E402

tables = read_tables()
for page, sections in SECTIONS.items():
    if "--write" in sys.argv[1:]:
        (DOCS / page).write_text(made((DOCS / page).read_text(encoding="utf-8"), page, tables), encoding="utf-8")
        continue
    for name, section in sections.items():
        print(f"{page}: {name}\n\n{section(tables)}\n")
