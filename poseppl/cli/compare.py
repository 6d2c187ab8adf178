"""The command `poseppl compare`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs
from poseppl.cli.options import common_options
from poseppl.errors import InputError, brief

EXAMPLES = """
\b
Examples:
  poseppl compare hmc.nc particle.nc
      Two results of poseppl track on the same data.
  poseppl compare short=runs/1/poseppl-walk.nc long=runs/2/poseppl-walk.nc -o walk.html --csv walk.csv
      Under names of your own, and every figure as a table too.

\b
Files written:
  comparison.html   the page, self-contained; an older one of the same name is replaced
  FILE.csv          with --csv: one row for each run, frame and coordinate
Both appear whole or not at all; results are never changed.

\b
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""

COVERAGE = "90 %\ncoverage\n(%)"
RHAT = "R-\nhat"


@click.command(epilog=EXAMPLES, short_help="Compare results on the same data.")
@click.argument(
    "results", metavar="[NAME=]RESULT [NAME=]RESULT ...", nargs=-1, type=InputFile(paths=lambda word: [_pair(word)[1]])
)
@click.option("--output", "-o", metavar="FILE.html", default="comparison.html", show_default=True, help="The page.")
@click.option("--csv", "table", metavar="FILE.csv", help="Every figure of every run, frame and coordinate as a table.")
@common_options
def compare(results: tuple[str, ...], output: str, table: str | None, quiet: bool) -> None:
    """Compare runs of any filters or smoothers on the same data: one HTML file that opens offline.

    Each RESULT is a file that poseppl track or smooth wrote, called NAME, or else by its own name. For each run, frame and
    coordinate the page shows R-hat, the inefficiency factor ± SE, the effective sample size (ESS) and rejection. It also shows
    ESS per second, per gradient and per evaluation of the likelihood or its gradient. If the truth is known, it shows error and
    coverage. It lists the winners by coordinate, and plots the variance of the mean against time. Runs of one setting with
    different seeds on the same points count as replicates. Chains that disagree are reported first: there the inefficiency
    factor says little. The table in the terminal has the seconds of all frames without compilation (wall time and processor
    time) and the largest R-hat. It has the median inefficiency factor τ and its mean, which a few frames that mix badly
    dominate. Further columns are ESS per second and per evaluation, the mean joint error, and the coverage of 90 % intervals of
    the coordinates.
    """
    from poseppl.cli.checks import check_writable, contents_of
    from poseppl.files.atomic_writing import atomic_path

    runs = _Results(_named(results))
    page = _target(output, "--output", ".html", ".htm")
    rows = None if table is None else _target(table, "--csv", ".csv")
    targets = [path for path in (page, rows) if path is not None]
    if len({path.resolve() for path in targets}) < len(targets):
        raise InputError("two outputs of one name", file=page)
    check_inputs()
    check_writable(targets, runs.files.values())

    from poseppl.diagnostics import compare as compare_runs
    from poseppl.report import write_comparison, write_comparison_table

    with contents_of(*runs.files.values()):
        comparison = compare_runs(runs, files=runs.files)
    with contents_of(*runs.files.values()), atomic_path(page) as drawn:
        write_comparison(comparison, drawn)
        if rows is not None:
            write_comparison_table(comparison, rows)
    if not quiet:
        _print(comparison, targets)


class _Results(Mapping[str, Any]):
    """Results by name, each loaded when it is asked for, so that one at a time is held."""

    def __init__(self, files: dict[str, Path]) -> None:
        self.files = files

    def __getitem__(self, name: str) -> Any:
        from poseppl.runs.results import load_result

        return load_result(self.files[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.files)

    def __len__(self) -> int:
        return len(self.files)


def _named(words: tuple[str, ...]) -> dict[str, Path]:
    if len(words) < 2:
        raise click.UsageError("give two results or more")
    files: dict[str, Path] = {}
    for word in words:
        name, path = _pair(word)
        if name in files:
            raise InputError(
                f"a second run called {brief(name)}, after {files[name]}", file=path, expected=f"another name: NAME={path}"
            )
        files[name] = Path(path)
    return files


def _pair(word: str) -> tuple[str, str]:
    """Name and file of a word; a file whose own name has an equals sign is one, too."""
    name, equals, path = word.partition("=")
    return (Path(word).stem, word) if not equals or Path(word).exists() else (name, path)


def _target(given: str, field: str, *suffixes: str) -> Path:
    path = Path(given)
    if path.suffix not in suffixes:
        raise InputError("not a name for this output", file=given, field=field, expected=f"NAME{suffixes[0]}")
    return path


def _print(comparison: Any, targets: list[Path]) -> None:
    from poseppl.cli.console import print_table
    from poseppl.diagnostics.verdicts.comparison import findings

    head, rows = _columns(comparison)
    print_table("poseppl compare", rows, head)
    for found in findings(comparison):
        click.echo(f"{found.text}")
    for path in targets:
        click.echo(f"{path}")


def _columns(comparison: Any) -> tuple[list[str], list[list[str]]]:
    """The runs, one a row; columns without a figure are left out."""
    from poseppl.report.compare_tables import covered
    from poseppl.report.page import filled, shown

    figures, summary = comparison["figures"].dataset, comparison["summary"].dataset
    frames = comparison.attrs["frames"]
    columns = {
        "wall\n(s)": frames * figures["seconds"],
        "CPU\n(s)": frames * figures["cpu_seconds"],
        RHAT: summary["rhat_all"],
        "τ": summary["tau_median_all"],
        "mean\nτ": summary["tau_all"],
        "ESS\n/ s": summary["ess_per_second_all"],
        "ESS /\neval.": summary["ess_per_evaluation_all"],
        "error\n(mm)": summary["joint_error_all"],
    }
    rows = [
        {"run": name, COVERAGE: covered(summary, index, 0.9)}
        | {title: shown(values.values[index], ".2f" if title == RHAT else "") for title, values in columns.items()}
        for index, name in enumerate(figures["run"].values.tolist())
    ]
    titles = [title for title, *_ in filled([(title, title, "") for title in ("run", *columns, COVERAGE)], rows)]
    return titles, [[row[title] for title in titles] for row in rows]
