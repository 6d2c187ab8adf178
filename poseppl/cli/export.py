"""The command `poseppl export`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import BUILDER, InputFile, check_inputs, number
from poseppl.cli.options import common_options
from poseppl.files.exchange_formats import files_of

FORMATS = ("trc", "mot", "c3d", "csv", "rrd")
BY_DEFAULT = ("trc", "mot")
"""What is written unless others are asked for, and by poseppl track of keypoints."""

EXAMPLES = """
\b
Examples:
  poseppl export poseppl-cam1-laplace.nc
      Joints and angles for OpenSim, beside the result.
  poseppl export run.nc --format trc mot c3d csv --output exported/ --level 0.5
      Everything, with intervals that hold half of the probability, in another folder.

\b
Files written, NAME being that of RESULT:
  NAME.trc                        mean places of the joints: mm, Y up
  NAME_lower.trc, NAME_upper.trc  ends of the interval of each coordinate
  NAME.mot   mean joint angles under the names of OpenSim's full-body models, degrees and m;
             its header says what each column is
  NAME.c3d   mean places, mm, Z up, with the spread as residual (needs pip install 'poseppl[mocap]')
  NAME.csv   a row a frame and coordinate: mean, lower, upper, standard deviation, of places and angles
  NAME.rrd   poses, draws, cameras and images over time, for the viewer of rerun
             (needs pip install 'poseppl[rerun]'; then: rerun NAME.rrd)
Older ones of the same name are replaced; RESULT never is.

\b
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


class WordsCommand(click.Command):
    """A command whose --format takes all the words up to the next option or file."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat --format before each of its words."""
        spread: list[str] = []
        taking = False
        for word in args:
            if taking and word in FORMATS and spread[-1] != "--format":
                spread.append("--format")
            spread.append(word)
            taking = word == "--format" or (taking and word in FORMATS)
        return super().parse_args(ctx, spread)


@click.command(cls=WordsCommand, epilog=EXAMPLES, short_help="Write a result for OpenSim and other programs.")
@click.argument("result", type=InputFile())
@click.option(
    "--format",
    "formats",
    metavar="NAME...",
    multiple=True,
    type=click.Choice(FORMATS),
    help="Which files: trc, mot, c3d, csv, rrd, several one after another. [default: trc mot; of named points trc]",
)
@click.option("--output", "-o", metavar="FOLDER", type=click.Path(), help="Where the files go. [default: beside RESULT]")
@click.option(
    "--level",
    metavar="SHARE",
    type=number("a share between 0 and 1, such as 0.9", lambda level: 0 < level < 1),
    default=0.9,
    show_default=True,
    help="What the intervals hold of the probability.",
)
@click.option(
    "--model",
    metavar="BUILDER",
    type=BUILDER,
    help="The body that was tracked, where it is not an installed one, for RESULT does not choose what is run; for angles. "
    "[default: the one that RESULT names]",
)
@common_options
def export(result: str, formats: tuple[str, ...], output: str | None, level: float, model: str | None, quiet: bool) -> None:
    """Write joints and angles with their intervals as files that OpenSim and other programs read.

    RESULT is a file that poseppl track or smooth wrote. The page "OpenSim and other programs" of the documentation
    (docs/opensim.md) explains the angles and which of them are OpenSim's.
    """
    from poseppl.cli.console import ConsoleProgress, start_jax
    from poseppl.cli.files import check_writable, contents_of, output_folder

    check_inputs()
    target = output_folder(output, result) / Path(result).name
    likely = files_of(target.parent, target.stem, formats or BY_DEFAULT)
    check_writable((path for paths in likely.values() for path in paths), [result])

    from poseppl.motion.tracking.export import has_angles
    from poseppl.runs.results import load_result

    tree = load_result(result)
    chosen = formats or (BY_DEFAULT if has_angles(tree) else BY_DEFAULT[:1])
    progress = ConsoleProgress(quiet)
    start_jax()
    with contents_of(result):
        files = write_exports(tree, target, progress.note, chosen, level=level, model=model)
    if not quiet:
        for path in files:
            click.echo(f"{path}")


def write_exports(
    tree: Any,
    target: Path,
    note: Any,
    formats: tuple[str, ...] = BY_DEFAULT,
    *,
    level: float = 0.9,
    model: str | None = None,
) -> list[Path]:
    """Write a result's files beside its own, and tell what the user should know of them.

    Args:
        tree: The result.
        target: Its file.
        note: Is told of a rate that nobody has said.
        formats: Which.
        level: Of the intervals.
        model: Builder of the body.
    """
    from poseppl.motion.tracking.estimates import clock_of
    from poseppl.motion.tracking.export import export as write

    if clock_of(tree).assumed:
        note(f"{target.stem}: nobody has said how many frames a second there are; its exported times are those of 30")
    return write(tree, target.parent, target.stem, formats, level=level, model=model)
