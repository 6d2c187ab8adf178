"""The page of an experiment: each claim, published and ours, with a verdict and the reason; made from its folder alone."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from poseppl.files.atomic_writing import write_atomically
from poseppl_papers.experiment import UNPUBLISHED, Experiment, Section, Tables
from poseppl_papers.tables import Kept, markdown, read_folder

PAGE, ERRATA = "page.md", "validation/errata.md"
CLAIM_COLUMNS = ("claim", "published", "ours", "verdict", "why")


def write_page(experiment: Experiment, folder: Path) -> Path:
    """Write the page of a folder as FOLDER/page.md.

    Raises:
        InputError: Its tables or their record cannot be read.
    """
    path = folder / PAGE
    write_atomically(path, page_of(experiment, folder))
    return path


def page_of(experiment: Experiment, folder: Path) -> str:
    """The page as Markdown.

    Raises:
        InputError: The tables or their record cannot be read.
    """
    kept = read_folder(folder)
    tables = {name: each.table for name, each in kept.items()}
    parts = [f"# {experiment.title}", experiment.setting]
    departures = "\n\n".join([experiment.departures, *_errata(experiment, folder)])
    leading: Mapping[str, Section] = {
        "Claims": partial(claims_of, experiment),
        "Not in the paper": partial(claims_of, experiment, published=False),
        "Departures from the paper": lambda _: departures,
    }
    for title, section in {**leading, **experiment.sections}.items():
        text = section(tables)
        parts += [f"## {title}", text] if text else []
    for file, title in experiment.pictures.items():
        if (folder / file).exists():
            parts += [f"## {title}", f"![{title}]({file})"]
    for name in experiment.shown:
        if name in kept:
            parts += _shown(name, kept[name])
    return "\n\n".join([*parts, *_runs(kept)]) + "\n"


def _errata(experiment: Experiment, folder: Path) -> list[str]:
    """A link to the list of errata, where the folder is beside one that has this paper."""
    path = folder.parent / ERRATA
    listed = path.exists() and f"(../{experiment.name}/{PAGE})" in path.read_text(encoding="utf-8")
    return [f"Statements of the paper that are wrong or contradict each other: [errata](../{ERRATA})."] if listed else []


def claims_of(experiment: Experiment, tables: Tables, *, published: bool = True) -> str:
    """The paper's claims, or those that are not in it, as a Markdown table; nothing where the tables decide none."""
    return markdown(CLAIM_COLUMNS, [each for each in experiment.claims(tables) if (each.theirs != UNPUBLISHED) == published])


def _shown(name: str, kept: Kept) -> list[str]:
    """A table, whole."""
    table, made = kept
    about = f"{table.about} {made.runs} runs: {made.recordings}."
    return [f"## {name.replace('_', ' ').capitalize()}", about, markdown(table.columns, table.rows)]


def _runs(kept: Mapping[str, Kept]) -> list[str]:
    """Provenance of each table."""
    rows = [(f"[{name}]({name}.csv)", *made[:3], made.versions, made.note) for name, (_, made) in kept.items()]
    commands = dict.fromkeys(made.command for _, made in kept.values())
    again = "\n".join(f"    {command}" for command in commands)
    return [
        "## Runs",
        markdown(("table", "runs", "recordings", "date", "with", "note"), rows),
        f"To make them again; what the folder holds already is not computed again:\n\n{again}",
    ]
