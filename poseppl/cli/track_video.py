"""The options of `poseppl track` that take pictures instead of points."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, file_of_pair, number
from poseppl.cli.options import OF_PLACED_CAMERAS, OF_RECORDINGS, chosen, option_group, refuse
from poseppl.cli.overlay import overlay_paths
from poseppl.cli.settings import CommandWithSettings
from poseppl.errors import InputError, brief
from poseppl.files.frame_range import FrameRange

MANY = ("--video", "--background", "--occlusion", "--masks", "--keypoints")
_ONLY = ("calibration", "background", "occlusion", "masks", "facing", "silhouette_noise", "refine", "edges")


class ManyFiles(CommandWithSettings):
    """A command some of whose options take all the words up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each of its words."""
        spread: list[str] = []
        option: str | None = None
        for word in args:
            if word.startswith("-"):
                option = word if word in MANY else None
                if option is None:
                    spread.append(word)
            elif option is not None:
                spread += [option, word]
            else:
                spread.append(word)
        return super().parse_args(ctx, spread)


video_options = option_group(
    click.option(
        "--video",
        metavar="FILE...",
        multiple=True,
        type=InputFile(folders=True, paths=file_of_pair),
        help="Videos to track instead of a recording, one a camera: FILE, named as the camera, or NAME=FILE; or a folder "
        "of poseppl simulate --video. Needs pip install 'poseppl[vision]'.",
    ),
    click.option(
        "--calibration",
        metavar="FILE",
        type=InputFile(folders=True),
        help="--video, --keypoints: the calibrated cameras.",
    ),
    click.option(
        "--background",
        metavar="FILE...",
        multiple=True,
        type=InputFile(folders=True, paths=file_of_pair),
        help="--video: background plates, pictures or clips of the empty scene, named as the cameras or NAME=FILE. "
        "[default: the background is learned from the videos]",
    ),
    click.option(
        "--occlusion",
        metavar="FILE...",
        multiple=True,
        type=InputFile(paths=file_of_pair),
        help="--video: occlusion masks, white where furniture stands before the person, named alike.",
    ),
    click.option(
        "--masks",
        metavar="FILE...",
        multiple=True,
        type=InputFile(folders=True, paths=file_of_pair),
        help="--video: masks instead of a background, white on the person, named alike: a video, a folder of pictures, or "
        ".npz as poseppl simulate --video writes it.",
    ),
    click.option(
        "--stature",
        metavar="MM",
        type=number("500 to 2500 mm", lambda stature: 500 <= stature <= 2500),
        help="--video, --observations, --keypoints: height of the person, whose segments are in proportion. [default: 1750, "
        "or the scene's truth; of keypoints measured by several cameras, any adult's in one]",
    ),
    click.option(
        "--facing",
        metavar="NAME",
        help="--video: the camera that the person faces at first, roughly; front and back look alike. [default: where "
        "the person goes]",
    ),
    click.option(
        "--silhouette-noise",
        metavar="MM",
        type=number("a positive number of mm", lambda noise: 0 < noise < 1e4),
        help="--video: standard deviation of a silhouette's distances at the body. [default: 80; with --prior 200]",
    ),
    click.option(
        "--refine",
        is_flag=True,
        default=None,
        help="--video: silhouettes completed by colour where the person looks like the background; some 40 ms a picture.",
    ),
    click.option("--edges", is_flag=True, default=None, help="--video: edges within the silhouettes count, too."),
)
"""Videos, their cameras and backgrounds."""


def check_video_usage(options: dict[str, Any], others: bool) -> None:
    """Refuse options that do not go together.

    Args:
        options: All options.
        others: Whether a recording or observations are given too.
    """
    if not options["video"]:
        shared = ("calibration",) if options["keypoints"] else ()
        refuse((name for name in _ONLY if name not in shared), "goes with --video")
        return
    if others:
        raise click.UsageError("give --video, a RECORDING or --observations, not two of them")
    refuse((*OF_RECORDINGS, *OF_PLACED_CAMERAS, "camera", "noise"), "does not go with --video")
    if not is_scene(options["video"]) and options["calibration"] is None:
        raise InputError("no calibration", field="--calibration", expected="a TOML file of the videos' cameras")
    for name in ("calibration", "up", "background", "occlusion", "masks") if is_scene(options["video"]) else ():
        if options[name]:
            problem = f"{options['video'][0]} has its own"
            raise InputError(problem, field=f"--{name}", expected="no such option with a scene's folder")
    if FrameRange.parse(options["frames"]).step > 1:
        raise InputError(brief(options["frames"]), field="--frames", expected="A:B, frames A to B - 1 of the videos")


def is_scene(words: Sequence[str]) -> bool:
    """Whether videos are those of a rendered scene, of which its folder alone is given."""
    return len(words) == 1 and "=" not in words[0] and (Path(words[0]) / "scene.toml").is_file()


def scene_of_options(sources: Any, options: dict[str, Any], progress: Any) -> Any:
    """Find the silhouettes that the options tell of."""
    from poseppl.motion.io import VideoWarning
    from poseppl.motion.silhouettes.frame import SilhouetteSettings
    from poseppl.motion.silhouettes.video_sources import DEFAULT_MODEL, see_silhouettes
    from poseppl.motion.vision import BackgroundSettings

    rate = options["rate"]
    frames = FrameRange.parse(options["frames"])
    start, stop = frames.start, frames.stop
    known = [video.num_frames for video in sources.videos if video.num_frames is not None]
    progress.stage("finding silhouettes", total=(min(known) if stop is None and known else stop or 0) - start)
    settings = SilhouetteSettings()
    if options["silhouette_noise"] is not None:
        settings = settings._replace(noise=options["silhouette_noise"])
    settings = settings._replace(edges=bool(options["edges"]))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", VideoWarning)
        scene = see_silhouettes(
            sources,
            model=options["model"] or DEFAULT_MODEL,
            settings=settings,
            background=BackgroundSettings(refine=bool(options["refine"])),
            start=start,
            stop=stop,
            advance=progress.advance,
            **chosen(options, "stature", "lengths", "facing", "on_failure"),
        )
    if rate is not None:
        scene = scene._replace(rate=rate)
    for warning in told:
        progress.note(str(warning.message))
    return scene


def open_sources(options: dict[str, Any]) -> Any:
    """Open the videos, and what goes with them."""
    from poseppl.motion.silhouettes.video_sources import sources_of_files, sources_of_scene

    words = options["video"]
    if is_scene(words):
        return sources_of_scene(words[0])
    return sources_of_files(
        words,
        options["calibration"],
        plates=options["background"],
        up=options["up"],
        **chosen(options, "occlusion", "masks"),
    )


def write_overlays(tree: Any, sources: Any, target: Path, progress: Any) -> list[tuple[str, Path]]:
    """Write the videos again, with the skeletons over them; those that were drawn."""
    from poseppl.cli.outputs import draw
    from poseppl.motion.rendering.overlay_video import write_overlay

    progress.stage("drawing overlays")
    paths = zip(overlay_paths(sources.videos, target), sources.videos, strict=True)
    return [("overlay", path) for path, video in paths if draw(path, partial(write_overlay, path, tree, video), progress.note)]
