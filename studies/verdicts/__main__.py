"""Print the parts of pages that tables make, or write them and the papers' pages: python -m studies.verdicts [--write]."""

from __future__ import annotations

import sys

from poseppl_papers.page import write_page

from studies.verdicts.pages import DOCS, SECTIONS, experiments, made, read_tables

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
