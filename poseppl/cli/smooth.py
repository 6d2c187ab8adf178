"""The command `poseppl smooth`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import BUILDER, InputFile, check_inputs
from poseppl.cli.options import chosen, common_options, max_draws_option, seed_option
from poseppl.cli.settings import CommandWithSettings, check_algorithm, settings_option

EXAMPLES = """
\b
Examples:
  poseppl smooth poseppl-walk.nc
      NUTS on all frames at once, started from the filter's draws.
  poseppl smooth poseppl-walk.nc --method forward-backward
      The filter's particles with new weights.
  poseppl smooth poseppl-cam_01.nc --method laplace --errors lasting
      A detector's keypoints, as poseppl track keypoints smooths them.
  poseppl smooth poseppl-walk.nc --set num_draws=500 --set num_chains=8
      More and longer chains of the default.

\b
Files written:
  NAME-METHOD.nc   the smoothed result, like that of poseppl track; poseppl report draws its report
  NAME-METHOD.png  a picture of it
NAME is that of RESULT. Older ones of the same name are replaced; RESULT never is.

\b
Exit status: 0 done, 1 bad input or a smoothing that breaks down, 2 wrong usage, 130 Ctrl-C.
"""


class SmoothCommand(CommandWithSettings):
    """The command, which takes the settings of smoothers."""

    kind = "smoother"


@click.command(cls=SmoothCommand, epilog=EXAMPLES, short_help="Smooth a result: every frame given all data.")
@click.argument("result", type=InputFile())
@click.option(
    "--method", metavar="NAME", default="trajectory", show_default=True, help="Smoother; poseppl smoothers lists them."
)
@settings_option
@click.option(
    "--errors",
    type=click.Choice(["independent", "lasting"]),
    default="independent",
    show_default=True,
    help="Errors of the points: independent from frame to frame, as in the filter; or lasting, that is autocorrelated and "
    "heavy-tailed, with markers beside their joints, like a detector's keypoints. The walk is then learned, too.",
)
@click.option(
    "--model",
    metavar="BUILDER",
    type=BUILDER,
    help="Builder of the tracked body: package.module:builder or FILE.py:builder. Needed for a body that is not installed, "
    "because RESULT never chooses which code runs. [default: the installed body that RESULT names]",
)
@click.option(
    "--prior",
    metavar="FILE.nc",
    type=InputFile(),
    help="The learned motion that RESULT was tracked with, which RESULT does not contain.",
)
@seed_option("Seed of the smoother.")
@max_draws_option
@click.option("--output", "-o", metavar="DIR|FILE.nc", help="File or folder of the result. [default: NAME-METHOD.nc, here]")
@common_options
def smooth(result: str, method: str, settings: dict[str, str], **options: Any) -> None:
    """Smooth the result of poseppl track: the posterior of every frame given all frames.

    RESULT is a file that poseppl track wrote. The smoother starts from the filter's particles or Gaussians, which RESULT keeps
    up to track's history_mib, or from the draws if it keeps none. Genealogy and fixed-lag follow all particles back through
    their ancestors: if RESULT keeps none, a particle filter runs again with its seed. A result of videos holds no pictures: use
    poseppl track --smooth METHOD. The page "Which filter, which smoother?" of the documentation compares smoothers.
    """
    from poseppl.cli.checks import check_writable, contents_of, output_path
    from poseppl.cli.console import ConsoleProgress, print_table, print_verdict, start_jax
    from poseppl.cli.outputs import summary, write_outputs

    check_algorithm("smoother", method, settings)
    check_inputs()
    target = output_path(options["output"], f"{Path(result).stem}-{method}", ".nc")
    check_writable([target, target.with_suffix(".png")], [result, *filter(None, [options["prior"]])])

    from poseppl.motion.tracking import SmoothSettings, smooth as smooth_result
    from poseppl.runs.algorithms import SMOOTHERS
    from poseppl.runs.results import load_result

    SMOOTHERS[method].check(settings)
    tree = load_result(result)
    progress = ConsoleProgress(options["quiet"])
    start_jax()
    with contents_of(result), progress.running():
        progress.stage(f"smoothing {tree['posterior'].sizes['frame']} frames")
        smoothed = smooth_result(
            tree, SmoothSettings(method, settings, **chosen(options, "seed", "max_draws", "model", "errors", "prior"))
        )
        progress.stage("drawing")
        files = write_outputs(smoothed, target, progress.note)
    if not options["quiet"]:
        print_table("poseppl smooth", [*summary(smoothed), *((name, str(path)) for name, path in files)])
    print_verdict(smoothed, target, options["quiet"])
