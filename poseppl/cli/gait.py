"""The commands `poseppl fit-gait` and `poseppl gait`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import FRAMES, RATE, InputFile, check_inputs, check_recording
from poseppl.cli.options import common_options, result_options
from poseppl.errors import InputError

FIT_EXAMPLES = """
\b
Examples:
  poseppl fit-gait 02_01.amc --skeleton 02.asf --harmonics 4 -o walk.json

\b
Files written: the JSON file: period (s), drift (mm/s), coefficients (mm, radians), lengths (mm).
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command("fit-gait", epilog=FIT_EXAMPLES, short_help="Fit the built-in walk to a recorded one.")
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
    from poseppl.cli.checks import check_writable
    from poseppl.cli.console import ConsoleProgress, start_jax
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


EXAMPLES = """
\b
Examples:
  poseppl gait poseppl-cam1-laplace.nc
      Steps, strides, events and joint angles of a walk, beside the result.
  poseppl gait walk.nc --level 0.95 --output clinic/

\b
Files written, NAME being that of RESULT:
  NAME_gait.html        a page for reading: figures, angles over the gait cycle, events
  NAME_gait.csv         a row a figure: side, unit, number, mean, lower, upper, SD between strides
  NAME_gait_events.csv  a row an event: heel strike or toe off, foot, mean time, lower, upper, s
  NAME_gait_cycles.csv  a row an angle and per cent of the cycle: mean, lower, upper, degrees
Older ones of the same name are replaced; RESULT never is.

\b
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command(epilog=EXAMPLES, short_help="Steps, strides and joint angles of a walk, with intervals.")
@click.argument("result", type=InputFile())
@result_options("Where the files go.", "The body that was tracked, where it is not an installed one.")
@common_options
def gait(result: str, output: str | None, level: float, model: str | None, quiet: bool) -> None:
    """Find the steps of a walk in a smoothed result, and write figures with intervals and a page to read.

    RESULT is a file that poseppl track keypoints wrote of several cameras, or poseppl smooth. Heel strikes and toe-offs are
    found in each draw of the posterior; the guide on gait says how exact they are.
    """
    from poseppl.cli.checks import check_writable, contents_of, output_folder
    from poseppl.cli.console import ConsoleProgress, start_jax

    check_inputs()
    target = output_folder(output, result) / Path(result).stem
    page, figures, events, cycles = (target.with_name(target.name + end) for end in ENDS)
    check_writable([page, figures, events, cycles], [result])

    from poseppl.files.atomic_writing import write_atomically, write_rows
    from poseppl.motion.report.pages import ShownMeasure, gait_html
    from poseppl.motion.tracking.gait import cycle_rows, event_rows, gait_of, measure_rows
    from poseppl.runs.results import load_result

    tree = load_result(result)
    start_jax()
    with contents_of(result):
        found = gait_of(tree, model=model)
    for text in found.notes:
        ConsoleProgress(quiet).note(text)
    measured, when = measure_rows(found, level), event_rows(found, level)
    write_rows(figures, [("figure", "side", "unit", "number", "mean", "lower", "upper", "sd_between"), *map(_cells, measured)])
    write_rows(events, [_EVENT, *map(_cells, when)])
    write_rows(cycles, [("angle", "side", "percent", "mean", "lower", "upper"), *map(_cells, cycle_rows(found, level))])
    rows = [dict(zip(("kind", "side", "mean", "lower", "upper"), row, strict=True)) for row in when]
    shown = [ShownMeasure(*row) for row in measured]
    title = f"Gait of {Path(result).stem}"
    write_atomically(page, gait_html(title, shown, _shown_cycles(found, level), rows, found.notes, level))
    if not quiet:
        for path in (page, figures, events, cycles):
            click.echo(f"{path}")


ENDS = ("_gait.html", "_gait.csv", "_gait_events.csv", "_gait_cycles.csv")
"""How names of the files end."""
_EVENT = ("event", "foot", "mean", "lower", "upper")


def _cells(row: tuple[object, ...]) -> list[object]:
    return [f"{value:.6g}" if isinstance(value, float) else value for value in row]


def _shown_cycles(found: Any, level: float) -> list[Any]:
    """The angles as the page shows them."""
    import numpy as np

    from poseppl.motion.report.pages import ShownCycle
    from poseppl.motion.tracking.gait import WORDS, quantiles

    off = {m.side: float(np.nanmean(m.draws)) for m in found.measures if m.name == "stance"}
    shown = []
    for cycle in found.cycles:
        mean, lower, upper = quantiles(cycle.draws, level)
        title = cycle.name.removesuffix(f"_{cycle.side}").replace("_", " ")
        shown.append(ShownCycle(title, WORDS[cycle.side], np.stack([lower, mean, upper]), off.get(cycle.side)))
    return shown
