"""The options of `poseppl track` that take a detector's keypoints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import Checked, InputFile, file_of_pair, known_name
from poseppl.cli.keypoint_words import (
    about_person,
    calibration_of,
    number_of_text,
    numbers_of_cameras,
    sizes_of_pictures,
    words_of_keypoints,
)
from poseppl.cli.options import OF_PLACED_CAMERAS, OF_RECORDINGS, chosen, option_group, refuse
from poseppl.cli.track_live import check_live_usage, live_options
from poseppl.declarations import declared
from poseppl.errors import InputError, PosepplError, brief
from poseppl.files.exchange_formats import files_of

LAYOUTS = ("coco17", "coco18", "body25", "body25b", "halpe26", "mediapipe33")
"""Those of :mod:`poseppl.motion.io.keypoint_layouts`."""
_ONLY = (
    "layout",
    "person",
    "keep_calibration",
    "keep_detections",
    "online",
    "no_export",
    "detector",
    "offset",
    "camera_rate",
    "keep_clocks",
    "unit",
    "image_size",
    "detector_errors",
    "live",
)


def _check_unit(unit: str, option: str) -> None:
    known = declared("poseppl.motion.io.length_units", "MM_PER_UNIT")
    expected = f"{', '.join(known)}, or a number of mm from 0.000001 to 1000000"
    if unit not in known and not 1e-6 <= number_of_text(unit, option, expected) <= 1e6:
        raise InputError(brief(unit), field=option, expected=expected)


source_options = option_group(
    click.option(
        "--keypoints",
        metavar="CAMERA=FILE...",
        multiple=True,
        type=InputFile(folders=True, paths=file_of_pair),
        help="Keypoints to track instead of a recording: for each camera of --calibration that is used, a detector's file, or "
        "its folder of one file a frame. Frames of the same number are of one time, but for offsets that are found, and told.",
    ),
    click.option(
        "--detector",
        metavar="NAME",
        type=known_name(lambda: declared("poseppl.motion.io.keypoints", "DETECTORS")),
        help="--keypoints: what wrote them: openpose, alphapose, mmpose, mediapipe, deeplabcut, sleap, caliscope, ultralytics, "
        "vitpose or freemocap. [default: found from their content]",
    ),
    click.option(
        "--layout",
        metavar="NAME",
        type=known_name(lambda: LAYOUTS),
        help="--keypoints: which points they are: coco17, coco18, body25, body25b, halpe26 or mediapipe33. "
        "[default: found from them]",
    ),
    click.option(
        "--person",
        metavar="N",
        type=click.IntRange(min=1),
        help="--keypoints: whom to track: 1 is the person who is seen best, 2 the next. [default: 1]",
    ),
    click.option(
        "--unit",
        metavar="UNIT",
        type=Checked(_check_unit),
        help="--keypoints: the unit of length of --calibration: mm, cm, m, or how many mm it has. [default: what the file "
        "says; else found from the person's size, and told]",
    ),
    click.option(
        "--image-size",
        metavar="CAMERA=WxH",
        multiple=True,
        default=None,
        help="--keypoints: width and height, px, of the pictures that the detector saw, where they are not of the calibrated "
        "size: cam2=960x540.",
    ),
    click.option(
        "--offset",
        metavar="CAMERA=FRAMES",
        multiple=True,
        default=None,
        help="--keypoints: frames by which a camera is late: what the others have in frame n, it has in frame n + FRAMES. "
        "[default: found from what several cameras see of the person, and told]",
    ),
    click.option(
        "--keep-clocks",
        is_flag=True,
        default=None,
        help="--keypoints: frames of the same number are of one time; no offset is sought.",
    ),
    click.option(
        "--camera-rate",
        metavar="CAMERA=RATE",
        multiple=True,
        default=None,
        help="--keypoints: frames a second of a camera that has others than --rate.",
    ),
    click.option(
        "--keep-calibration",
        is_flag=True,
        default=None,
        help="--keypoints: take the cameras' places as they are. [default: small errors of them are found from what several "
        "cameras see of the person, and told]",
    ),
    click.option(
        "--keep-detections",
        is_flag=True,
        default=None,
        help="--keypoints: take the detector's points, left and right, and who is who, as they are. [default: points that "
        "leap, exchanged limbs and detections of others are found from what several cameras see over time, and told]",
    ),
)
"""A detector's keypoints, and whom of those it found."""

keypoint_options = option_group(
    source_options,
    click.option(
        "--online",
        is_flag=True,
        default=None,
        help="--keypoints: the filter's answer alone, of each frame given those before it. [default: NAME-laplace.nc beside "
        "it, smoothed with errors that last; NAME-assumed-density.nc of one camera]",
    ),
    click.option(
        "--no-export",
        is_flag=True,
        default=None,
        help="--keypoints: no .trc and .mot files for OpenSim; poseppl export writes them later.",
    ),
    live_options,
    click.option(
        "--detector-errors",
        metavar="FILE.json",
        type=InputFile(),
        help="--keypoints: the detector's errors, by keypoint and confidence, as poseppl calibrate-detector finds them. "
        "[default: one noise a camera, measured, that grows as the root of the confidence falls]",
    ),
)
"""The same, and what is made of them."""


def _clocks(options: dict[str, Any]) -> Any:
    from poseppl.motion.keypoints.sources import Clocks
    from poseppl.motion.tracking.walk import ASSUMED_RATE

    rates, offsets = _rates(options), numbers_of_cameras(options["offset"], "--offset")
    return Clocks(options["rate"] or ASSUMED_RATE, rates, offsets, not options["keep_clocks"])


def _rates(options: dict[str, Any]) -> dict[str, float]:
    """Frames a second of the cameras that have their own."""
    rates = numbers_of_cameras(options["camera_rate"], "--camera-rate")
    for camera, own in rates.items():
        if not 1e-3 <= own <= 1e5:
            raise InputError(f"{camera}={own:g}", field="--camera-rate", expected="0.001 to 100000 frames a second")
    if rates and options["rate"] is None:
        raise InputError("it needs --rate, that of the other cameras", field="--camera-rate")
    return rates


def check_source_words(options: dict[str, Any]) -> None:
    """Refuse words of cameras that are not of their form, before anything is read.

    Raises:
        InputError: A word is such.
    """
    words_of_keypoints(options["keypoints"])
    numbers_of_cameras(options["offset"], "--offset")
    _rates(options)
    sizes_of_pictures(options)


def check_keypoint_usage(options: dict[str, Any], others: bool) -> None:
    """Refuse options that do not go together.

    Args:
        options: All options.
        others: Whether a recording or observations are given too.
    """
    check_live_usage(options)
    if not options["keypoints"]:
        refuse(_ONLY, "goes with --keypoints")
        return
    if others:
        raise click.UsageError("give --keypoints, a RECORDING or --observations, not two of them")
    if options["calibration"] is None:
        raise click.UsageError("--keypoints needs --calibration FILE")
    if options["detector_errors"] is not None and options["noise"] is not None:
        raise click.UsageError("give --detector-errors or --noise, not both")
    refuse((*OF_RECORDINGS[1:], *OF_PLACED_CAMERAS, "camera"), "does not go with --keypoints")
    check_source_words(options)


def wants_points(options: dict[str, Any]) -> bool:
    """Whether keypoints are of anything, each a point by itself, rather than of a person's body."""
    paths = words_of_keypoints(options["keypoints"]).values()
    if paths and str(options["skeleton"] or "").lower().endswith(".toml"):
        return True
    if not paths or not all(path.lower().endswith(".csv") for path in paths):
        return False
    from poseppl.motion.points.files import is_point_table

    return all(map(is_point_table, paths))


def check_kind_of_keypoints(options: dict[str, Any]) -> None:
    """Refuse options that do not go with what the files of keypoints hold, which must be there.

    Raises:
        click.UsageError: One of them is given.
    """
    if not options["keypoints"]:
        return
    if not wants_points(options):
        refuse(("skeleton",), "does not go with --keypoints")
    elif options["smooth_method"] is not None:
        raise click.UsageError("points with names of their own are smoothed anyway: leave --smooth out")


def keypoint_scene(options: dict[str, Any], model: str, progress: Any) -> Any:
    """The scene that the options tell of, with what the user should know of it."""
    found = keypoint_recording(options, progress, model=model)
    return found.scene


def keypoint_recording(options: dict[str, Any], progress: Any, **more: Any) -> Any:
    """What was found of the person that the options tell of; the user is told what is unexpected.

    Args:
        options: Of the command.
        progress: Is told.
        more: Of :func:`~poseppl.motion.keypoints.scene.scene_of_keypoints`.
    """
    from poseppl.motion.keypoints.scene import scene_of_keypoints

    found = scene_of_keypoints(
        words_of_keypoints(options["keypoints"]),
        calibration_of(options),
        clocks=_clocks(options),
        rate=options["rate"],
        mend=not options["keep_detections"],
        **chosen(options, "detector", "frames"),
        **about_person(options),
        **more,
    )
    for note in found.notes():
        progress.note(note)
    return found


def exported_targets(options: dict[str, Any], target: Path) -> list[Path]:
    """The files for other programs of a result."""
    from poseppl.cli.export import BY_DEFAULT

    if not options["keypoints"] or options["no_export"]:
        return []
    return [path for paths in files_of(target.parent, target.stem, BY_DEFAULT).values() for path in paths]


def write_exported(tree: Any, target: Path, options: dict[str, Any], progress: Any) -> list[tuple[str, Path]]:
    """Write a result's files for other programs; what fails is told, and costs no result.

    Returns:
        What was written, and where.
    """
    from poseppl.cli.export import write_exports

    if not options["keypoints"] or options["no_export"]:
        return []
    progress.stage("exporting")
    try:
        found = write_exports(tree, target, progress.note, model=options["model"])
    except PosepplError as error:
        progress.note(f"not exported for other programs, but the result is written (--no-export leaves it out): {error}")
        return []
    return [("for OpenSim", path) for path in found]
