"""The page: each published claim, theirs and ours, whether it holds, and why; made of what a folder holds and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from poseppl.experiments.choo_fleet.claims import claims
from poseppl.experiments.choo_fleet.goals import Goal, goals
from poseppl.experiments.provenance import Kept, read_folder
from poseppl.experiments.tables import markdown
from poseppl.files.atomic_writing import write_atomically

PAGE = "page.md"
PICTURES = {
    "variances.png": "Variance against time and evaluations (Figs. 2 and 3)",
    "sequence.png": "Both filters over time (Figs. 4 and 5)",
    "poses.png": "Mean poses at frame 10 (Fig. 6)",
    "tuning.png": "Tuning (section 7.5)",
    "contest.png": "The contest",
}
_SHOWN = ("speed_ups", "volumes", "references", "sequence_summary", "contest", "contest_sequences")
_SETTING = (
    "One camera at 5 m, noise 0.003, random walk of 15 mm and 0.15 rad a frame at 30 frames a second. A gradient counts as one "
    "evaluation. Each process has one core to itself, unless a table says that the machine was busy."
)
_DEPARTURES = """\
- Resampling is systematic; the paper draws with replacement (multinomial).
- An estimate takes R - 6 draws of each chain; the paper, whose chains hold R + 1 samples with the first one, R - 5.
- Step sizes are ours (0.7, 0.3 and 0.25 for 4, 10 and 28 dimensions against 10.3, 4.0 and 3.0): the paper does not tell the \
curvature that its own multiply (Eq. 17), and with our Gauss-Newton curvature none above 2 is stable.
- All references are long HMC runs; the paper's are, for 4 and 10 dimensions, particle filters.
- Recordings and frame rate are ours; the paper does not tell its rate."""


def write_page(folder: Path) -> Path:
    """Write the page of a folder as FOLDER/page.md.

    Raises:
        InputError: Its tables or their record cannot be read.
    """
    path = folder / PAGE
    write_atomically(path, page_of(folder))
    return path


def page_of(folder: Path) -> str:
    """The page as Markdown.

    Raises:
        InputError: The tables or their record cannot be read.
    """
    kept = read_folder(folder)
    tables = {name: each.table for name, each in kept.items()}
    parts = ["# Choo and Fleet 2001, run again", _SETTING, "Where this departs from the paper:", _DEPARTURES]
    rows = claims(tables)
    if rows:
        parts += ["## Claims", markdown(("claim", "theirs", "ours", "verdict", "why"), rows)]
    reached = goals(tables)
    if reached:
        parts += ["## Goals", markdown(Goal._fields, reached)]
    for file, title in PICTURES.items():
        if (folder / file).exists():
            parts += [f"## {title}", f"![{title}]({file})"]
    for name in _SHOWN:
        if name in kept:
            table, made = kept[name]
            about = f"{table.about} {made.runs} runs: {made.recordings}."
            parts += [f"## {name.replace('_', ' ').capitalize()}", about, markdown(table.columns, table.rows)]
    return "\n\n".join([*parts, *_runs(kept)]) + "\n"


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
