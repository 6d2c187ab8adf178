"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from poseppl.cli.checks import BUILDER, FRAMES, RATE, InputFile, number

Command = TypeVar("Command", bound=Callable[..., Any])
Option = Callable[[Any], Any]


OF_RECORDINGS = ("skeleton", "names", "scale")
OF_PLACED_CAMERAS = ("cameras", "camera_distance", "view")


def option_group(*given: Option) -> Callable[[Command], Command]:
    """Make one decorator of several options, which help lists in this order."""

    def decorate(command: Command) -> Command:
        for option in reversed(given):
            command = option(command)
        return command

    return decorate


def seed_option(purpose: str | None = None) -> Option:
    """The option --seed."""
    return click.option("--seed", metavar="N", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help=purpose)


def chosen(options: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Some of the options, as arguments of the same names."""
    return {name: options[name] for name in names}


def refuse(names: Iterable[str], told: str) -> None:
    """Refuse options of the command that is running if they are given.

    Args:
        names: Those that are refused.
        told: The end of the message, such as "does not go with --live".

    Raises:
        click.UsageError: One of them is given.
    """
    source = click.get_current_context().get_parameter_source
    for name in names:
        if source(name) != ParameterSource.DEFAULT:
            raise click.UsageError(f"--{name.removesuffix('_name').replace('_', '-')} {told}")


subject_options = option_group(
    click.option(
        "--skeleton",
        metavar="ASF",
        type=InputFile(),
        help="Skeleton of an .amc recording; character of a DeepMimic motion; .json of exponential maps.",
    ),
    click.option(
        "--names",
        metavar="TOML",
        type=InputFile(),
        help="Which points of the recording are which markers, where its names are unusual: lines such as "
        'knee_l = "lShin", or neck = ["C7", "CLAV"] for the mean of several.',
    ),
    click.option(
        "--lengths",
        metavar="TOML",
        type=InputFile(),
        help="Segment lengths that are known, mm: lines such as thigh = 435.0. [default: measured in a recording; "
        "those of --stature otherwise]",
    ),
    click.option(
        "--model",
        metavar="NAME",
        type=BUILDER,
        help="Body to track: package.module:builder or FILE.py:builder. "
        "[default: poseppl_models.bodies.choo_fleet:full_body; lower_body and arm are there too, with all other joints "
        "clamped to the truth]",
    ),
    click.option(
        "--frames",
        metavar="A:B:C",
        type=FRAMES,
        help="Frames A to B - 1 in steps of C, counted from 0; each part may be left out. "
        "[default: all; 0:60 of the built-in walk]",
    ),
    click.option(
        "--rate",
        metavar="HZ",
        type=RATE,
        help="Frames a second, where the file does not tell. [default: 120 for .amc and exponential maps, else 30]",
    ),
    click.option(
        "--scale",
        metavar="MM",
        type=number("a positive number of millimetres", lambda scale: 0 < scale < 1e6),
        help="Millimetres a unit of a .bvh file. [default: guessed from the skeleton's height]",
    ),
    click.option(
        "--up",
        type=click.Choice(["x", "y", "z", "-x", "-y", "-z"]),
        help="Axis that points up in a .bvh, .c3d or .trc file or in --calibration. [default: along which the head is above "
        "the feet; the choice is printed]",
    ),
)
"""Who is seen: a recording, or the built-in walk."""


camera_options = option_group(
    click.option(
        "--camera",
        metavar="TOML",
        type=InputFile(folders=True),
        help="Calibrated cameras (our own form or anipose's). [default: cameras placed around the subject]",
    ),
    click.option(
        "--cameras",
        metavar="N",
        type=number("1 to 4", lambda count: 1 <= count <= 4, click.INT),
        help="How many cameras are placed, 1 to 4, each at a right angle to the one before. [default: 1]",
    ),
    click.option(
        "--camera-distance",
        metavar="MM",
        type=number("100 to 1000000 mm", lambda distance: 100 <= distance <= 1e6),
        help="Distance of placed cameras from the subject's path, mm. [default: 5000]",
    ),
    click.option(
        "--view",
        metavar="DEGREES",
        type=number("-360 to 360 degrees", lambda view: abs(view) <= 360),
        help="From where the first camera sees the walk: 90 the right side, 0 the front, 180 the back. [default: 90]",
    ),
    click.option(
        "--noise",
        metavar="FRACTION",
        type=number("a positive fraction of the focal length, such as 0.003", lambda noise: 0 <= noise < 10),
        help="Standard deviation of the image noise as a fraction of the focal length: 0.003 is 3 mm at 1 m, and 3 "
        "pixels at a focal length of 1000. [default: the body's, 0.003]",
    ),
)
"""From where the subject is seen."""


max_draws_option = click.option(
    "--max-draws",
    metavar="N",
    type=click.IntRange(1),
    help="Draws kept of each chain, or of all particles; means and intervals are made from all of them anyway. "
    "[default: as many as fit into 256 MiB]",
)


history_option = click.option(
    "--history-mib",
    metavar="MIB",
    type=click.FloatRange(0),
    default=256.0,
    show_default=True,
    help="Room in the result for what smoothers start from: all particles, or the Gaussians. 0 keeps none; a run that needs "
    "more keeps none and says so.",
)


def _alone(context: click.Context, option: click.Parameter, address: str | None) -> str | None:
    if address and context.params["workers"] is not None:
        raise click.UsageError("--workers does not go with --scheduler")
    return address


worker_options = option_group(
    click.option("--workers", metavar="N", type=click.IntRange(1), is_eager=True, help="Processes. [default: one a core]"),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        callback=_alone,
        help="Dask scheduler, such as tcp://host:8786, instead of processes; its workers read and write these folders.",
    ),
)
"""Who does the jobs."""


common_options = option_group(
    click.option("--quiet", "-q", is_flag=True, help="No progress and no table; warnings are still told."),
    click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."),
)
"""How much is said."""
