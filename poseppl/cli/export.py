"""The command `poseppl export`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs
from poseppl.cli.options import common_options, result_options
from poseppl.files.exchange_formats import files_of

FORMATS = ("trc", "mot", "osim", "bvh", "c3d", "csv", "rrd")
BY_DEFAULT = ("trc", "mot", "osim")
"""Default formats, which poseppl track also writes for keypoints."""

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
  NAME.osim  a model of OpenSim with the person's lengths, for both
  NAME.bvh   mean motion of a rig, for Blender and Unity
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
    help="Formats to write, separated by spaces: " + ", ".join(FORMATS) + ". [default: trc mot osim; of named points trc]",
)
@result_options(
    "Folder of the files.",
    "Builder of the tracked body, for angles: package.module:builder or FILE.py:builder. Needed for a body that is not "
    "installed, because RESULT does not choose what is run.",
)
@click.option(
    "--rig",
    type=click.Choice(("poseppl", "mixamo", "blender")),
    default="mixamo",
    show_default=True,
    help="Names of the joints in the .bvh file.",
)
@click.option(
    "--unit", type=click.Choice(("mm", "cm", "m")), default="cm", show_default=True, help="Unit of length of the .bvh file."
)
@common_options
def export(
    result: str, formats: tuple[str, ...], output: str | None, level: float, model: str | None, quiet: bool, **rigged: str
) -> None:
    """Write joints and angles with their intervals as files that OpenSim and other programs read.

    RESULT is a file that poseppl track or smooth wrote. The page "OpenSim and other programs" of the documentation
    (docs/opensim.md) explains the angles and which of them are OpenSim's.
    """
    from poseppl.cli.checks import check_writable, contents_of, output_folder
    from poseppl.cli.console import ConsoleProgress, start_jax

    check_inputs()
    target = output_folder(output, result) / Path(result).name
    likely = files_of(target.parent, target.stem, formats or BY_DEFAULT)
    check_writable((path for paths in likely.values() for path in paths), [result])

    from poseppl.runs.results import load_result

    tree = load_result(result)
    progress = ConsoleProgress(quiet)
    start_jax()
    with contents_of(result):
        files = write_exports(tree, target, progress.note, formats, level=level, model=model, **rigged)
    if not quiet:
        for path in files:
            click.echo(f"{path}")


def write_exports(
    tree: Any,
    target: Path,
    note: Any,
    formats: tuple[str, ...] = (),
    *,
    level: float = 0.9,
    model: str | None = None,
    **rigged: Any,
) -> list[Path]:
    """Write a result's files beside its own, and tell what the user should know of them.

    Args:
        tree: The result.
        target: Its file.
        note: Receives a message if no rate is known, or a joint was not seen.
        formats: Which; the usual ones if none.
        level: Level of the intervals.
        model: Builder of the body.
        **rigged: Rig and unit of a .bvh file.
    """
    from poseppl.motion.tracking.estimates import clock_of, unseen_of
    from poseppl.motion.tracking.export import export as write, usual_formats

    if clock_of(tree).assumed:
        note(f"{target.stem}: the frame rate is unknown; exported times assume 30 frames a second")
    unseen = unseen_of(tree).markers
    if unseen:
        note(f"{target.stem}: no camera saw {', '.join(unseen)}; exported files leave these joints out or mark them")
    return write(tree, target.parent, target.stem, formats or usual_formats(tree, model), level=level, model=model, **rigged)
