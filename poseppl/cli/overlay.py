"""The command `poseppl overlay`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs, file_of_pair
from poseppl.cli.options import common_options

EXAMPLES = """
\b
Examples:
  poseppl overlay poseppl-walk-laplace.nc cam1.mp4 cam2.mp4
  poseppl overlay poseppl-walk-laplace.nc cam1=front.mp4 --output videos

\b
Files written, STEM being that of RESULT:
  STEM-CAMERA.mp4  the frames of RESULT with sampled skeletons, thin, and their mean over them
Older ones of the same name are replaced; RESULT and the videos never are.

\b
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command(epilog=EXAMPLES, short_help="Draw a result over the videos of its cameras.")
@click.argument("result", type=InputFile())
@click.argument("videos", nargs=-1, required=True, metavar="VIDEO...", type=InputFile(folders=True, paths=file_of_pair))
@click.option("--output", "-o", metavar="FOLDER", type=click.Path(), help="Folder of the videos. [default: that of RESULT]")
@common_options
def overlay(result: str, videos: tuple[str, ...], output: str | None, quiet: bool) -> None:
    """Draw the posterior over the videos of its cameras, for any source of tracking.

    RESULT is a file that poseppl track or smooth wrote. VIDEO is a file named as its camera, or CAMERA=FILE; frame 0 of the
    result is its first picture, also where a camera's clock was found to differ. Needs pip install 'poseppl[vision]'.
    """
    from poseppl.cli.checks import check_writable, contents_of, output_folder
    from poseppl.cli.console import ConsoleProgress

    check_inputs()
    folder = output_folder(output, result)

    from poseppl.motion.rendering.overlay_video import write_overlay
    from poseppl.motion.silhouettes.video_sources import open_named
    from poseppl.runs.results import load_result

    tree, opened = load_result(result), open_named(videos)
    paths = overlay_paths(opened, folder / Path(result).name)
    check_writable(paths, [result, *(word.rpartition("=")[2] for word in videos)])
    progress = ConsoleProgress(quiet, doing="drawing")
    with progress.running(), contents_of(result):
        for path, video in zip(paths, opened, strict=True):
            progress.stage(f"drawing {path.name}", tree["posterior"].sizes["frame"])
            write_overlay(path, tree, video, progress.advance)
    if not quiet:
        for path in paths:
            click.echo(f"{path}")


def overlay_paths(videos: Any, target: Path) -> list[Path]:
    """Files of the overlays of a result's videos, beside a file."""
    return [target.with_name(f"{target.stem}-{video.camera}.mp4") for video in videos]
