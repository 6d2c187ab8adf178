"""The page's tables about other libraries: lines of programs, counted again, and what the text says of seconds and errors."""

from __future__ import annotations

import ast
from statistics import fmean

from benchmarks.peers.__main__ import COLUMNS, HERE, count_lines
from studies.verdicts.pages import read_tables

TABLE = read_tables()["library_jobs"]


def seconds(job: str, library: str, method: str = "", column: str = "seconds") -> float:
    """The mean of the turns."""
    rows = [row for row in TABLE.records(job=job) if row["library"].startswith(library) and method in row["method"]]
    return fmean(row[column] for row in rows)


def counted() -> set[tuple[str, str, int]]:
    """Library, method and lines of each library's file."""
    found = set()
    for path in HERE.glob("with_*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("NAME, PACKAGE, METHOD"):
                name, _, method, *_ = ast.literal_eval(line.partition(" = ")[2])
                found.add((name, method, count_lines(path)))
    return found


def test_rows_are_of_all_files_and_their_lines_are_right() -> None:
    assert TABLE.columns == COLUMNS
    written = {(row["library"].split()[0], row["method"], row["lines"]) for row in TABLE.records()}
    assert len(written) > 30 and written == counted()


def test_seconds_are_as_the_text_says() -> None:
    for rival in ("dynamax", "smcx"):
        assert seconds("level", rival) < 2e-3 < seconds("level", "poseppl", "Kalman")
    for rival in ("particles", "cuthbert"):
        assert seconds("level", "poseppl", "bootstrap") < seconds("level", rival)
    assert seconds("parallel", "poseppl", "parallel") > seconds("parallel", "poseppl", "one after")
    assert seconds("gradient", "poseppl") < seconds("gradient", "dynamax")
    assert seconds("smc2", "smcx") < min(seconds("smc2", library) for library in ("poseppl", "particles"))
    assert seconds("markov", "hmmlearn") < seconds("markov", "poseppl")
    later = {library: seconds("nile", library) for library in ("statsmodels", "poseppl", "dynestyx", "pymc-extras")}
    assert min(later, key=lambda library: later[library]) == "dynestyx" and later["pymc-extras"] > 10 * later["poseppl"]
    assert seconds("nile", "statsmodels", column="first_seconds") < 0.1


def test_maxima_are_the_same() -> None:
    for job in ("markov", "regimes", "nile"):
        errors = {row["library"].split()[0]: row["error"] for row in TABLE.records(job=job)}
        assert max(error for library, error in errors.items() if library != "statsmodels") < 1e-3
        assert errors["poseppl"] < 1e-4
