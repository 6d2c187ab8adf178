"""Print what the pages say between their marks, or write it, and the experiments' pages: python docs/verdicts [--write]."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])

from poseppl.experiments.page import write_page  # noqa: E402
from verdicts.pages import DOCS, SECTIONS, experiments, made, read_tables  # noqa: E402

tables = read_tables()
for page, sections in SECTIONS.items():
    if "--write" in sys.argv[1:]:
        (DOCS / page).write_text(made((DOCS / page).read_text(encoding="utf-8"), page, tables), encoding="utf-8")
        continue
    for name, section in sections.items():
        print(f"{page}: {name}\n\n{section(tables)}\n")
if "--write" in sys.argv[1:]:
    for experiment in experiments():
        write_page(experiment, DOCS / experiment.name)
