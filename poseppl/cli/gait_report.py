"""The command `poseppl gait`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs
from poseppl.cli.options import common_options, result_options

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
    from poseppl.cli.console import ConsoleProgress, start_jax
    from poseppl.cli.files import check_writable, contents_of, output_folder

    check_inputs()
    target = output_folder(output, result) / Path(result).stem
    page, figures, events, cycles = (target.with_name(target.name + end) for end in ENDS)
    check_writable([page, figures, events, cycles], [result])

    from poseppl.files.atomic_writing import write_atomically, write_rows
    from poseppl.motion.report.gait_page import ShownMeasure, gait_html
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

    from poseppl.motion.report.gait_page import ShownCycle
    from poseppl.motion.tracking.gait import WORDS, quantiles

    off = {m.side: float(np.nanmean(m.draws)) for m in found.measures if m.name == "stance"}
    shown = []
    for cycle in found.cycles:
        mean, lower, upper = quantiles(cycle.draws, level)
        title = cycle.name.removesuffix(f"_{cycle.side}").replace("_", " ")
        shown.append(ShownCycle(title, WORDS[cycle.side], np.stack([lower, mean, upper]), off.get(cycle.side)))
    return shown
