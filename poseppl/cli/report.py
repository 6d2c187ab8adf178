"""The command `poseppl report`."""

from __future__ import annotations

from pathlib import Path

import click

from poseppl.cli.checks import InputFile, check_inputs
from poseppl.cli.options import common_options
from poseppl.errors import InputError

EXAMPLES = """
\b
Examples:
  poseppl report poseppl-walk.nc              writes poseppl-walk.html
  poseppl report run.nc -o /tmp/report.html

\b
Files written: the HTML file, self-contained; an older one of the same name is replaced.
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command(epilog=EXAMPLES, short_help="Write the report of a result.")
@click.argument("result", type=InputFile())
@click.option("--output", "-o", metavar="FILE.html", help="The report. [default: RESULT with the suffix .html]")
@common_options
def report(result: str, output: str | None, quiet: bool) -> None:
    """Write the report of a run as one HTML file that opens offline.

    RESULT is a file that poseppl track, run, batch or smooth wrote. The report lists verdicts, with the setting to change
    and the gain to expect. It leads with R-hat, the inefficiency factor ± SE, and ESS per second and per gradient, by
    coordinate. It shows data, predictions and sites over time and, if the truth is known, error and coverage. For a body it
    also shows poses with their uncertainty, joints over time, errors by camera, and joints of low confidence with frames
    and reasons.
    """
    from poseppl.cli.checks import check_writable, contents_of

    check_inputs()
    target = Path(result).with_suffix(".html") if output is None else Path(output)
    if target.suffix not in (".html", ".htm"):
        raise InputError("not a name for the report", file=target, field="--output", expected="NAME.html")
    check_writable([target], [result])

    from poseppl.cli.options import as_option
    from poseppl.report import write_report
    from poseppl.runs.results import load_result

    tree = load_result(result)
    with contents_of(result):
        write_report(tree, target, name=as_option)
    if not quiet:
        click.echo(f"{target}")
