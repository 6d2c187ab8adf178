"""The command `poseppl demo`."""

from __future__ import annotations

import click

from poseppl.cli.checks import check_inputs, number
from poseppl.cli.options import common_options, seed_option

EXAMPLES = """
\b
Examples:
  poseppl demo walk
      Four cameras' keypoints of a walk, their calibration, and the truth.
  poseppl track keypoints camera_1=walk/camera_1 camera_2=walk/camera_2 camera_3=walk/camera_3 \\
      camera_4=walk/camera_4 --calibration walk/Calib.toml --rate 60
      Track what was written.

\b
Files written, into FOLDER, which is new or empty:
  camera_N/camera_N_FRAME_keypoints.json  OpenPose's BODY_25, a file a frame
  Calib.toml                              the cameras, each turned and moved a little
  truth.trc, truth.mot                    true places of the joints (mm, Y up) and true angles

\b
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command(epilog=EXAMPLES, short_help="Write a recording to try poseppl with, and its truth.")
@click.argument("folder", type=click.Path())
@click.option(
    "--seconds",
    metavar="S",
    type=number("0.5 to 60 seconds", lambda seconds: 0.5 <= seconds <= 60),
    default=3.0,
    show_default=True,
    help="How long the person walks.",
)
@seed_option("Seed of the detector's errors.")
@common_options
def demo(folder: str, seconds: float, seed: int, quiet: bool) -> None:
    """Simulate a walk that a detector sees in four cameras at 60 frames a second, with a detector's faults.

    Errors grow as the confidence falls, half of their variance lasts for half a second, tails are heavy. Points are missing or
    anywhere in the picture, and left and right limbs are exchanged for some frames. The same seed writes the same files.
    """
    from poseppl.cli.console import print_table, start_jax

    check_inputs()
    start_jax()

    from poseppl.motion.keypoints.demo import write_demo

    written = write_demo(folder, seconds=seconds, seed=seed)
    if not quiet:
        print_table("poseppl demo", [(name, str(path)) for name, path in written.items()])
