"""What the documentation says of claims and goals is what its committed tables say."""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "docs"))

from verdicts import image_claims, sampling  # noqa: E402
from verdicts.measured import Measured, difference, find, over_runs  # noqa: E402
from verdicts.pages import DOCS, MARKED, SECTIONS, made, read_tables  # noqa: E402

from poseppl.experiments.provenance import read_folder  # noqa: E402
from poseppl.experiments.tables import Table  # noqa: E402

PAGES = sorted(path.name for path in DOCS.glob("*.md"))
VERDICT = re.compile(r"\b(holds|does not hold|not reached|was reached|undecided)\b(?! \d| nearer|, unless)", re.IGNORECASE)


def text_of(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", SECTIONS)
def test_marked_parts_are_made_from_tables(page):
    text = text_of(page)
    assert [found[2] for found in MARKED.finditer(text)] == list(SECTIONS[page])
    assert text == made(text, page, read_tables())  # else: python docs/verdicts --write


@pytest.mark.parametrize("page", PAGES)
def test_no_verdict_stands_outside_of_them(page):
    rest = MARKED.sub("", text_of(page))
    judged = [line for line in rest.splitlines() if re.search(r"\b(claims?|goals?)\b", line) and VERDICT.search(line)]
    assert not judged


def test_every_table_has_its_record():
    folder = DOCS / "tables"
    assert {path.stem for path in folder.glob("*.csv")} == set(read_folder(folder))


KEYS = {"dimension", "particles", "frames", "cameras", "exponent", "run", "evaluations", "seed", "rate", "pose", "starts"}
UNSHOWN = {"weighted_relative", "weighted_relative_sd", "weight", "weight_sd", "failed", "seconds"}


def changed(table: Table, column: str) -> Table:
    """A table with the numbers of one column changed."""
    index = table.columns.index(column)

    def other(number: int, value: object) -> object:
        return 1.37 * value + 1 if number == index and not isinstance(value, str) else value

    return table._replace(rows=[tuple(other(*each) for each in enumerate(row)) for row in table.rows])


def same_pages(tables: dict[str, Table]) -> bool:
    return all(text_of(page) == made(text_of(page), page, tables) for page in SECTIONS)


@pytest.mark.parametrize("name", sorted(path.stem for path in (DOCS / "tables").glob("*.csv")))
def test_another_number_in_a_table_is_another_page(name):
    tables = read_tables()
    last = zip(tables[name].columns, tables[name].rows[-1], strict=True)
    numeric = [column for column, value in last if column not in KEYS and not isinstance(value, str)]
    unnoticed = {column for column in numeric if same_pages(tables | {name: changed(tables[name], column)})}
    assert unnoticed <= UNSHOWN and len(unnoticed) < len(numeric)


@pytest.mark.parametrize("page", SECTIONS)
def test_another_number_on_a_page_is_noticed(page):
    text, tables = text_of(page), read_tables()
    for part in MARKED.finditer(text):
        numbers = [found for found in re.finditer(r"\d", part[3])]
        for digit in (numbers[0], numbers[len(numbers) // 2], numbers[-1]):
            place = part.start(3) + digit.start()
            wrong = f"{text[:place]}{(int(digit[0]) + 1) % 10}{text[place + 1 :]}"
            assert made(wrong, page, tables) == text != wrong


def sweep_table(plain: dict[float, list[float]], annealed: list[float]) -> Table:
    columns = ("diffusion", "filter", "exponent", "absolute", "ess_share")
    rows = [("peursum", "Simple-PF, 10,000", rate, error, 0.1) for rate, errors in plain.items() for error in errors]
    rows += [("peursum", "Simple-APF, 10 x 1,000", "", error, 0.5) for error in annealed]
    return Table("image_exponents", columns, rows + [("peursum-measured", *row[1:]) for row in rows])


@pytest.mark.parametrize(
    ("errors", "verdict"),
    [([60.0, 61.0, 62.0], "holds"), ([90.0, 91.0, 92.0], "does not hold"), ([50.0, 66.0, 90.0], "undecided")],
)
def test_a_sharpened_filter_is_judged_by_two_standard_errors(errors, verdict):
    table = sweep_table({10.0: errors, 60.0: [120.0, 121.0, 122.0]}, [59.0, 60.0, 61.0])
    found = image_claims._sharpened({"image_exponents": table})[2].split("; ")
    no = "does not hold"
    expected = [f"{no} at lambda = 10, 60"] if verdict == no else [f"{verdict} at lambda = 10", f"{no} at lambda = 60"]
    heads = [f"with the {name} diffusion {expected[0]}" for name in ("published", "measured")]
    assert found == [heads[0], *expected[1:], heads[1], *expected[1:]]


@pytest.mark.parametrize(("relative", "verdict"), [(221.0, "holds"), (130.0, "does not hold")])
def test_a_filter_fails_that_is_worse_than_the_pose_it_starts_from(relative, verdict):
    columns = ("system", "method", "runs", "absolute", "absolute_sd", "relative", "relative_sd")
    rows = [("darby, Eq. 8", "(holds the first pose)", 1, 562.0, math.nan, 123.0, math.nan)]
    rows += [("darby, Eq. 8", "APF, 5 x 1,000", 10, 220.0, 9.0, relative, 15.0)]
    rows += [("darby, Eq. 9", "APF, 5 x 1,000", 10, 137.0, 6.0, 134.0, 6.0)]
    standard, modified = image_claims._one_camera({"image_runs_one_camera": Table("", columns, rows)})
    # 130 - 2 * 15 / sqrt(10) is below 123
    assert standard[2] == verdict and modified[2] == "holds" and "83 +- 3 less" in modified[1]


@pytest.mark.parametrize(
    ("weight", "verdict"), [(0.02, "does not hold"), (0.1, "holds against CONDENSATION alone"), (0.2, "holds")]
)
def test_weights_are_compared_with_both_rivals(weight, verdict):
    columns = ("method", "runs", "evaluations", "absolute", "absolute_sd", "weight", "weight_sd")
    names = ("CONDENSATION, 5,000", "APF, 10 x 500", "DE-MC (velocity), 7 layers of 437", "DE-MC (transition), 7 layers of 437")
    rows = [(name, 3, 5000, 100.0, 1.0, each, 0.0) for name, each in zip(names, (0.03, 0.15, weight, weight), strict=True)]
    assert image_claims._weights({"image_runs_du_guan": Table("", columns, rows)})[2] == verdict


def test_the_goal_of_draws_a_second_needs_both_ratios():
    columns = ("frames", "worst", "median", "numpyro_worst", "numpyro_median", "ratio_worst", "ratio_median")
    rows = [(25, 1.0, 2.0, 0.1, 0.2, 5.4, 7.1), (100, 1.0, 2.0, 0.1, 0.2, 4.3, 7.0)]
    assert "25 frames: reached; 100 frames: not reached" in sampling.trajectory({"trajectory": Table("", columns, rows)})


def test_errors_of_means_and_differences():
    measured = over_runs([1.0, 2.0, 3.0, 6.0])
    assert measured.mean == 3.0 and measured.spread == pytest.approx((14 / 3) ** 0.5) and measured.runs == 4
    assert measured.error == pytest.approx((14 / 12) ** 0.5)
    assert difference(Measured(5.0, 6.0, 4), Measured(1.0, 4.0, 1)) == (4.0, 5.0)
    assert Measured(5.04, math.nan, 1).told(1) == "5.0" and Measured(138.7, 10.9, 3).told() == "139 +- 11"
    table = Table("", ("name", "runs", "x", "x_sd"), [("a", 3, 1.0, 0.5), ("b", 4, 2.0, 0.7)])
    assert find(table, "x", name="b") == Measured(2.0, 0.7, 4)
