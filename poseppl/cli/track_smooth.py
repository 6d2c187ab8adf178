"""`poseppl track --smooth`: the smoothed result beside the filter's, while what was seen is at hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.options import chosen
from poseppl.errors import InputError, PosepplError

smooth_option = click.option(
    "--smooth",
    "smooth_method",
    metavar="METHOD",
    help="Smooth the result, too: every frame given all; poseppl smoothers lists the methods. Results of videos, which hold no "
    "pictures, can be smoothed here alone. [default: laplace for --keypoints, assumed-density for those of one camera, "
    "otherwise none]",
)


def check_smooth_usage(options: dict[str, Any]) -> None:
    """Refuse options that do not go with --smooth."""
    if options["smooth_method"] is None:
        return
    for name in ("live", "online", "prior"):
        if options.get(name):
            raise click.UsageError(f"--smooth does not go with --{name}")


_OF_FILTER = ("filter_name", "settings", "smooth_method", "online", "live", "prior", "checkpoint", "resume")
"""Options that ask for a filter, or for what only a filter does."""


def goes_straight(options: dict[str, Any]) -> bool:
    """Whether a recording is smoothed without a filter: keypoints of several cameras, where nobody asks for one."""
    return len(options["keypoints"]) > 1 and options["devices"] == 1 and not any(options.get(name) for name in _OF_FILTER)


def smoothing_method(options: dict[str, Any]) -> str | None:
    """The smoother that is asked for, or that keypoints get unless somebody says otherwise.

    In one camera the likeliest trajectory is far from most that are likely: one that is too near (studies/one_camera.py).
    """
    given: str | None = options["smooth_method"]
    by_default = options["keypoints"] and not (options["online"] or options.get("live"))
    alone = len(options["keypoints"]) == 1
    return given or (("assumed-density" if alone else "laplace") if by_default else None)


def smoothed_target(options: dict[str, Any], target: Path) -> Path | None:
    """The file of the smoothed result; None if there is to be none."""
    method = smoothing_method(options)
    return None if method is None else target.with_name(f"{target.stem}-{method}.nc")


def smoothed(tree: Any, scene: Any, options: dict[str, Any], progress: Any) -> Any:
    """A result smoothed, of keypoints with a detector's lasting errors; None where they could not be, which is told.

    One camera does not tell errors that last from how far away the person is: there they are independent.

    Raises:
        PosepplError: The result, which is written, cannot be smoothed by the method that was asked for.
    """
    from poseppl.motion.tracking import SmoothSettings, smooth
    from poseppl.runs.smoothing import SmoothingError

    progress.stage(f"smoothing {tree['posterior'].sizes['frame']} frames")
    settings = SmoothSettings(
        str(smoothing_method(options)),
        errors="lasting" if options["keypoints"] and len(scene.camera_names) > 1 else "independent",
        **chosen(options, "seed", "max_draws", "model"),
    )
    try:
        return smooth(tree, settings, scene if options["video"] else None)
    except (InputError, SmoothingError) as error:
        if options["smooth_method"]:
            raise PosepplError(f"not smoothed, but the filter's result is written: {error}") from error
        progress.note(f"not smoothed (--online leaves it out): {error}")
        return None
