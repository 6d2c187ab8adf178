"""The documentation's statements about claims and goals are those of its committed tables."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from poseppl_papers.page import PAGE, claims_of, page_of
from poseppl_papers.tables import Table, read_folder

from studies.verdicts import sampling
from studies.verdicts.pages import DOCS, FOLDERS, MARKED, SECTIONS, experiments, made, read_tables, tables_of

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md") if path.name != PAGE)
VERDICT = re.compile(r"\b(holds|does not hold|not reached|was reached|undecided)\b(?! \d| nearer|, unless)", re.IGNORECASE)


@cache
def tables_read() -> dict[str, Table]:
    return read_tables()


def text_of(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


@pytest.mark.full
@pytest.mark.parametrize("page", SECTIONS)
def test_marked_parts_are_made_from_tables(page):
    text = text_of(page)
    assert [found[2] for found in MARKED.finditer(text)] == list(SECTIONS[page])
    assert text == made(text, page, tables_read())  # else: python -m studies.verdicts --write


@pytest.mark.parametrize("page", PAGES)
def test_no_verdict_stands_outside_of_them(page):
    rest = MARKED.sub("", text_of(page))
    judged = [line for line in rest.splitlines() if re.search(r"\b(claims?|goals?)\b", line) and VERDICT.search(line)]
    assert not judged


@pytest.mark.parametrize("folder", FOLDERS.values(), ids=lambda folder: folder.name)
def test_every_table_has_its_record(folder):
    assert {path.stem for path in folder.glob("*.csv")} == set(read_folder(folder))


@pytest.mark.parametrize("experiment", experiments(), ids=lambda experiment: experiment.name)
def test_an_experiments_page_says_what_its_tables_say(experiment):
    folder = DOCS / experiment.name
    page = (folder / PAGE).read_text(encoding="utf-8")
    assert page == page_of(experiment, folder)  # else: python -m studies.verdicts --write
    assert all(f"({path.name})" in page for path in folder.glob("*.png"))


KEYS = {"dimension", "particles", "frames", "cameras", "exponent", "run", "evaluations", "seed", "rate", "pose", "starts"}
KEYS |= {"temperature", "sequence", "held_out", "person", "coordinates", "rank", "strike_share"}
UNSHOWN = {"weighted_relative", "weighted_relative_sd", "weight", "weight_sd", "failed", "seconds"}


def changed(table: Table, column: str) -> Table:
    """A table with the numbers of one column changed."""
    index = table.columns.index(column)

    def other(number: int, value: object) -> object:
        return 1.37 * value + 1 if number == index and not isinstance(value, str) else value

    return table._replace(rows=[tuple(other(*each) for each in enumerate(row)) for row in table.rows])


class Watched(dict[str, Table]):
    """Tables that note which of them are asked for."""

    def __init__(self, tables: dict[str, Table]) -> None:
        super().__init__(tables)
        self.asked: set[str] = set()

    def __getitem__(self, name: str) -> Table:
        self.asked.add(name)
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        self.asked.add(name)
        return super().get(name, default)

    def items(self) -> Any:
        self.asked |= set(self)
        return super().items()


@cache
def parts() -> list[tuple[Callable[[dict[str, Table]], str], set[str], str]]:
    """Parts of pages: functions of tables, the tables that each needs, and its text."""
    makers: list[Callable[[dict[str, Table]], str]] = [maker for page in SECTIONS.values() for maker in page.values()]
    for experiment in experiments():
        name = experiment.name
        makers += [lambda tables, each=experiment, name=name: claims_of(each, tables_of(name, tables))]
        makers += [lambda tables, make=make, name=name: make(tables_of(name, tables)) for make in experiment.sections.values()]
    found = []
    for make in makers:
        watched = Watched(tables_read())
        said = make(watched)
        found.append((make, watched.asked, said))
    return found


def says_the_same(name: str, tables: dict[str, Table]) -> bool:
    """Whether pages say the same with another table of that name."""
    return all(make(tables) == said for make, asked, said in parts() if name in asked)


SHOWN_WHOLE = {f"{experiment.name}/{name}" for experiment in experiments() for name in experiment.shown}
_IN_FIGURES = ("variances", "coordinates", "sequence", "autocorrelation", "burn_in", "tuning")
DRAWN = {f"choo-fleet-2001/{name}" for name in _IN_FIGURES}
"""Tables whose rows are too many for the page, which shows them in figures."""


@pytest.mark.full
@pytest.mark.parametrize("name", sorted(tables_read().keys() - SHOWN_WHOLE - DRAWN))
def test_another_number_in_a_table_is_another_page(name):
    tables = tables_read()
    last = zip(tables[name].columns, tables[name].rows[-1], strict=True)
    numeric = [column for column, value in last if column not in KEYS and not isinstance(value, str)]
    numeric = [column for column in numeric if any(value == value for value in tables[name].column(column))]  # not NaN alone
    unnoticed = {column for column in numeric if says_the_same(name, tables | {name: changed(tables[name], column)})}
    allowed = UNSHOWN | ({"modes"} if name.startswith("sminchisescu-triggs-2001/") else set())
    assert unnoticed <= allowed and len(unnoticed) < len(numeric)


@pytest.mark.full
@pytest.mark.parametrize("page", SECTIONS)
def test_another_number_on_a_page_is_noticed(page):
    text, tables = text_of(page), tables_read()
    for part in MARKED.finditer(text):
        numbers = [found for found in re.finditer(r"\d", part[3])]
        for digit in (numbers[0], numbers[len(numbers) // 2], numbers[-1]):
            place = part.start(3) + digit.start()
            wrong = f"{text[:place]}{(int(digit[0]) + 1) % 10}{text[place + 1 :]}"
            assert made(wrong, page, tables) == text != wrong


def test_the_goal_of_draws_a_second_needs_both_ratios():
    columns = ("frames", "worst", "median", "numpyro_worst", "numpyro_median", "ratio_worst", "ratio_median")
    rows = [(25, 1.0, 2.0, 0.1, 0.2, 5.4, 7.1), (100, 1.0, 2.0, 0.1, 0.2, 4.3, 7.0)]
    assert "25 frames: reached; 100 frames: not reached" in sampling.trajectory({"trajectory": Table("", columns, rows)})


@pytest.mark.full
@pytest.mark.parametrize(("worst", "told"), [(1200.0, "reached (6; 1 times)"), (800.0, "not reached (4; 1 times)")])
def test_the_goal_of_particle_mgrad_is_in_the_worst_coordinate(worst, told):
    columns = ("method", "draws", "cpu_seconds", "ess_worst", "ess_median")
    rows = [("NUTS", 150, 10.0, 200.0, 1000.0), ("Particle-mGRAD", 1500, 10.0, worst, 1000.0)]
    assert f"coordinate: {told}." in sampling.particle_mgrad({"particle_mgrad": Table("", columns, rows)})
    rows[0] = ("NUTS", 150, 10.0, 5.0, 1000.0)
    assert "effective samples below 100" in sampling.particle_mgrad({"particle_mgrad": Table("", columns, rows)})
