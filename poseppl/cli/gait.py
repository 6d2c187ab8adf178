"""The command `poseppl fit-gait`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from poseppl.cli.checks import FRAMES, RATE, InputFile, check_inputs, check_recording
from poseppl.cli.options import common_options
from poseppl.errors import InputError

EXAMPLES = """
\b
Examples:
  poseppl fit-gait 02_01.amc --skeleton 02.asf --harmonics 4 -o walk.json

\b
Files written: the JSON file: period (s), drift (mm/s), coefficients (mm, radians), lengths (mm).
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command("fit-gait", epilog=EXAMPLES, short_help="Fit the built-in walk to a recorded one.")
@click.argument("recording", type=InputFile())
@click.option("--skeleton", metavar="ASF", type=InputFile(), help="Skeleton of an .amc recording.")
@click.option("--frames", metavar="A:B:C", type=FRAMES, help="Frames A to B - 1 in steps of C, counted from 0. [default: all]")
@click.option("--rate", metavar="HZ", type=RATE, help="Frames a second, if the file has no rate. [default: 120 for .amc]")
@click.option(
    "--harmonics", metavar="K", type=click.IntRange(1, 20), default=4, show_default=True, help="Harmonics of the gait cycle."
)
@click.option("--output", "-o", metavar="FILE.json", default="walk.json", show_default=True, help="The gait.")
@common_options
def fit_gait(
    recording: str,
    skeleton: str | None,
    frames: str | None,
    rate: float | None,
    harmonics: int,
    output: str,
    quiet: bool,
) -> None:
    """Fit a gait in closed form, harmonics of the joint angles, to a recorded walk along a straight line.

    This made the built-in walk. The recording has to hold at least 1.1 cycles (two steps each).
    """
    from poseppl.cli.console import ConsoleProgress, start_jax
    from poseppl.cli.files import check_writable
    from poseppl.files.atomic_writing import atomic_path

    target = Path(output)
    check_recording(recording, skeleton)
    check_inputs()
    check_writable([target], [recording, skeleton])

    from poseppl_models.bodies.gait import gait_table

    from poseppl.motion.io import read_motion, slice_frames

    start_jax()
    motion = read_motion(recording, skeleton, rate=rate)
    for note in motion.notes:
        ConsoleProgress(quiet).note(f"{recording}: {note}")
    if frames is not None:
        motion = slice_frames(motion, frames)
    try:
        table = gait_table(motion, harmonics)
    except ValueError as error:
        raise InputError(str(error), file=recording) from error
    with atomic_path(target, inputs=[recording]) as temporary:
        temporary.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    if not quiet:
        click.echo(f"{target}")
