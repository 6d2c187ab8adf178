"""The command `poseppl run`: one's own model on one's own data."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import RATE, Checked, InputFile, check_code, check_inputs, check_rows
from poseppl.cli.options import common_options, history_option, option_group, seed_option
from poseppl.cli.settings import CommandWithSettings, check_algorithm, settings_option
from poseppl.errors import InputError, brief
from poseppl.files.csv_fields import decimal_number

EXAMPLES = """
\b
Examples:
  poseppl run model.py --data heights.csv
      The programs `model = StateSpaceModel(...)` of a file, on the columns that are called like its data.
  poseppl run model.py:trend --data series.parquet --filter kalman --inputs temperature
      Another name in the file; a column that the programs get as inputs["temperature"].
  poseppl run model.py --data heights.csv --filter particle --set num_particles=5000 --smooth backward-simulation
      Filtered, and smoothed as well.
  poseppl run model.py --data heights.csv --filter kalman --fit poseppl-heights-ml.nc
      With the parameters that poseppl fit found.
  poseppl run model.py --data heights.csv --settings run.toml --json
      Options from a file; what came of it as JSON on stdout.

\b
The model: a file of three NumPyro programs (docs/your_model.md); it is run, as any script of yours.
The data: one row a frame. A site y without a shape is the column y, the entries of one of shape (2,) the
columns y[0] and y[1]; what is empty or NaN is missing; a column `frame` has frame numbers.
Settings: lines such as filter = "particle", seed = 3 and set = {num_particles = 5000}; the command line goes first.

\b
Files written:
  poseppl-NAME.nc           the result; NAME is that of the data
  poseppl-NAME.png          a picture of it
  poseppl-NAME-METHOD.nc    with --smooth, the smoothed result, and its picture

\b
Exit status: 0 done, 1 bad input or a run that cannot continue, 2 wrong usage, 130 Ctrl-C.
"""


_NOT_OF_FILES = ("settings", "model", "scheduler")


def _read_settings(context: click.Context, option: click.Parameter, path: str | None) -> str | None:
    """Take defaults of the other options from a TOML file."""
    if path is None:
        return None
    from poseppl.files.bounded_reading import read_toml

    # what code runs, and where, is the command line's to say
    known = {p.opts[0].lstrip("-"): p for p in context.command.params if isinstance(p, click.Option)} | {
        p.opts[0].lstrip("-").replace("-", "_"): p for p in context.command.params if isinstance(p, click.Option)
    }
    defaults: dict[str, Any] = {}
    for name, value in read_toml(path).items():
        if name not in known or name in _NOT_OF_FILES:
            expected = ", ".join(sorted(set(known) - set(_NOT_OF_FILES)))
            raise InputError(f"no option {brief(name)} of a settings file", file=path, expected=expected)
        given = [f"{key}={each}" for key, each in value.items()] if isinstance(value, dict) else value
        defaults[str(known[name].name)] = given
    context.default_map = {**(context.default_map or {}), **defaults}
    return path


def _numbers(context: click.Context, option: click.Parameter, words: tuple[str, ...]) -> dict[str, float]:
    found = {name.strip(): decimal_number(value.strip()) for name, _, value in (word.partition("=") for word in words)}
    numbers = {name: value for name, value in found.items() if value is not None and math.isfinite(value)}
    if len(numbers) < len(found):
        raise click.BadParameter("expected NAME=NUMBER, such as noise=0.3")
    return numbers


series_options = option_group(
    click.option(
        "--settings",
        "settings_file",
        metavar="TOML",
        type=InputFile(),
        is_eager=True,
        callback=_read_settings,
        help="Options from a TOML file; the command line overrides them.",
    ),
    click.option(
        "--inputs",
        metavar="NAME",
        multiple=True,
        help="Column passed to the programs as inputs[NAME]; repeat for more. [default: no inputs]",
    ),
)
"""A file of options, and the columns that are inputs."""


fill_gaps_option = click.option(
    "--fill-gaps",
    is_flag=True,
    help="Insert frames without data where the column frame has gaps, so that each step is one frame; their inputs repeat "
    "the frame before. [default: one transition leads across a gap, with a warning]",
)


table_options = option_group(
    click.option(
        "--data",
        metavar="FILE",
        type=InputFile(),
        required=True,
        help="A table, one row a frame: .csv, .parquet, or variables in .nc.",
    ),
    click.option(
        "--frames", metavar="A:B:C", type=Checked(check_rows), help="Rows A to B - 1 of the table in steps of C. [default: all]"
    ),
)


model_options = option_group(
    series_options,
    click.option(
        "--param",
        "params",
        metavar="NAME=NUMBER",
        multiple=True,
        callback=_numbers,
        help="Parameter passed to the programs as params[NAME]; repeat for more.",
    ),
    click.option(
        "--fit",
        "fit_file",
        metavar="FILE.nc",
        type=InputFile(),
        help="Parameters from a file that poseppl fit wrote; --param overrides single ones.",
    ),
    click.option(
        "--filter",
        "filter_name",
        metavar="NAME",
        default="particle",
        show_default=True,
        help="Filter; poseppl filters lists them.",
    ),
    settings_option,
    click.option(
        "--hindcast",
        metavar="H",
        type=click.IntRange(1),
        help="Forecast 1 to H frames ahead from every frame, and score the forecasts by the data; poseppl compare shows it.",
    ),
    fill_gaps_option,
    click.option("--smooth", metavar="METHOD", help="Smooth the result, too; poseppl smoothers lists the methods."),
    seed_option(),
    click.option(
        "--max-draws", metavar="N", type=click.IntRange(1), default=200, show_default=True, help="Draws kept of a frame."
    ),
    history_option,
)
"""The model and what is done with it, as poseppl run and poseppl batch take them."""


def check_model(model: str, options: dict[str, Any]) -> None:
    """Refuse a model whose code is not there, algorithms and settings that there are not, and files that cannot be read.

    Raises:
        InputError: There is such a one.
    """
    check_code(model.partition(":")[0], "MODEL")
    check_algorithm("filter", options["filter_name"], options["settings"])
    if options["smooth"]:
        check_algorithm("smoother", options["smooth"])
    check_inputs()


@click.command(cls=CommandWithSettings, epilog=EXAMPLES, short_help="Run a filter of your own model on your own data.")
@click.argument("model")
@table_options
@model_options
@click.option("--rate", metavar="HZ", type=RATE, help="Frames a second.")
@click.option("--output", "-o", metavar="DIR|FILE.nc", help="File or folder of the result. [default: poseppl-NAME.nc, here]")
@click.option("--json", "as_json", is_flag=True, help="Print a summary as JSON instead of a table.")
@common_options
def run(model: str, data: str, **options: Any) -> None:
    """Run a filter of the state-space model in MODEL, FILE.py[:NAME] or package.module[:NAME], on a table of data."""
    from poseppl.cli.checks import check_writable, output_path
    from poseppl.cli.console import ConsoleProgress, print_table, print_verdict, start_jax
    from poseppl.cli.outputs import write_outputs

    check_model(model, options)
    target = output_path(options["output"], f"poseppl-{Path(data).stem}", ".nc")
    second = target.with_name(f"{target.stem}-{options['smooth']}.nc") if options["smooth"] else None
    targets = [target, *([second] if second else [])]
    check_writable([path.with_suffix(end) for path in targets for end in (".nc", ".png")], [data])

    from poseppl.cli.model_runs import described, filtered, smoothed

    progress = ConsoleProgress(options["quiet"] or options["as_json"], "filtering")
    start_jax()
    with progress.running():
        found = filtered(model, data, options, progress)
        results = {target: found.result} | ({second: smoothed(found, options, progress)} if second else {})
        progress.stage("drawing")
        files = {path: write_outputs(tree, path, progress.note) for path, tree in results.items()}
    if options["as_json"]:
        click.echo(json.dumps([described(results[path], files[path]) for path in results], indent=2))
        return
    for path, tree in results.items():
        if not options["quiet"]:
            about = described(tree, files[path])
            rows = [(name, str(value)) for name, value in about.items() if name not in ("verdicts", "last frame")]
            print_table("poseppl run", rows)
        print_verdict(tree, path, options["quiet"])
