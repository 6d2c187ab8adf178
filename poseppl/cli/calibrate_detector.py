"""The command `poseppl calibrate-detector`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs, file_of_pair, words_of_files
from poseppl.cli.options import common_options, made, option_group, options_of, seed_option
from poseppl.cli.settings import ManyFiles
from poseppl.motion.keypoints.settings import KeypointSettings

_OPTIONS = ("calibration", "rate", "frames", "unit", "up", "detector", "layout", "camera", "person", "keep")

EXAMPLES = """
\b
Examples:
  poseppl calibrate-detector openpose cam1=pose/cam1 cam2=pose/cam2 cam3=pose/cam3
      --calibration Calib.toml --rate 60
  poseppl track keypoints cam1=other/cam1 cam2=other/cam2 --calibration Other.toml --noise openpose.json
      The errors that were found, for another recording by the same detector.

\b
Files written: NAME.json: scales of the keypoints, mm at the person, and how they depend on the
confidence.
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


class CalibrateCommand(ManyFiles):
    """The command, whose files may stand after `--keypoints`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, as click does."""
        return super().parse_args(ctx, [word for word in args if word != "--keypoints"])


@click.command(
    "calibrate-detector",
    cls=CalibrateCommand,
    epilog=EXAMPLES,
    short_help="Learn the errors of a detector's keypoints.",
)
@click.argument("name")
@click.argument(
    "files",
    nargs=-1,
    required=True,
    metavar="CAMERA=FILE...",
    type=InputFile(folders=True, paths=file_of_pair),
)
@option_group(*options_of(KeypointSettings, *_OPTIONS))
@seed_option("Seed of the draws.")
@common_options
def calibrate_detector(name: str, **options: Any) -> None:
    """Measure the errors of a detector's keypoints, by keypoint and by the detector's confidence.

    Three or more cameras see a person. The keypoints of each camera are compared with those of the others. This gives the scale
    of each keypoint's error, its growth as the logit of the confidence falls, and the share of clutter. The table shows the
    coverage of 50 and 90 % intervals in each half of the recording. It compares the errors measured in the other half with the
    noise that poseppl track would use without this file. Use the file with poseppl track keypoints --noise NAME.json.
    """
    from poseppl.cli.checks import check_writable, files_read
    from poseppl.cli.console import ConsoleProgress, print_table, start_jax

    settings = made(KeypointSettings, options | {"files": words_of_files(options["files"])})
    check_inputs()
    target = Path(name if name.endswith(".json") else f"{name}.json")
    check_writable([target], files_read(settings))

    from poseppl.motion.keypoints.detector_calibration import calibrate_detector as calibrate
    from poseppl.motion.keypoints.detector_files import write_detector_errors
    from poseppl.motion.keypoints.scene import scene_of_keypoints

    progress = ConsoleProgress(options["quiet"])
    start_jax()
    with progress.running():
        progress.stage("reading")
        found = scene_of_keypoints(settings)
        for note in found.notes():
            progress.note(note)
        progress.stage("calibrating")
        result = calibrate(found, options["seed"])
    write_detector_errors(result.errors, target)
    if not options["quiet"]:
        print_table("errors of the keypoints", _keypoint_rows(result.errors), ("keypoint", "scale, mm", "residuals"))
        print_table("poseppl calibrate-detector", [*_rows(result), ("errors", str(target))])


def _keypoint_rows(errors: Any) -> list[tuple[str, str, str]]:
    from math import exp

    return [(name, f"{exp(value):.1f}", str(errors.counts[name])) for name, value in errors.log_scale.items()]


def _rows(result: Any) -> list[tuple[str, str]]:
    from scipy.special import expit

    errors = result.errors
    lines = [
        ("at confidence", f"{errors.confidence:.2f}"),
        ("log scale, by logit of confidence", f"{errors.slope:+.2f}"),
        ("clutter", f"{expit(errors.clutter):.2%}"),
        ("log-odds of clutter, by logit", f"{errors.clutter_slope:+.2f}"),
    ]
    for when, held in (("one noise a camera", result.before), ("other half's errors", result.after)):
        lines += [
            (f"{when}: coverage of 50 % intervals", f"{held.levels[4]:.1%}"),
            (f"{when}: coverage of 90 % intervals", f"{held.levels[8]:.1%}"),
            (f"{when}: ECE", f"{held.ece:.3f}"),
            (f"{when}: mean log-density", f"{held.log_density:.3f}"),
        ]
    return lines
