"""The command `poseppl simulate`: observations of a subject, or videos of one in a room (`--video`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs, check_recording, number
from poseppl.cli.options import common_options, made, option_group, options_of, seed_option
from poseppl.errors import InputError, Phrase
from poseppl.motion.recordings.settings import RecordingSettings

EXAMPLES = """
\b
Examples:
  poseppl simulate
      Observations of the built-in walk, through one camera.
  poseppl simulate 02_01.amc --skeleton 02.asf --cameras 2 --missing 0.1 -o data/
      A recording through two cameras; a tenth of the markers is missing.
  poseppl track observations poseppl-walk.csv --camera poseppl-walk.toml
      Track what was written, without the truth.
  poseppl simulate 02_01.amc --skeleton 02.asf --frames ::4 --video -o room/
      Videos of a person in a room with four cameras and furniture in the way, with masks and truth.
  poseppl simulate 02_01.amc --skeleton 02.asf --frames ::2 --turn 1200 --no-clutter --video -o circle/
      The same walk to the left along a circle of 1.2 m, in an empty room.

\b
Files written:
  poseppl-NAME.csv   the points: frame, marker, x, y (pixels), and camera where there are several
  poseppl-NAME.toml  the cameras
  poseppl-NAME.nc    the truth: markers in mm and the body's states, an xarray DataTree
With --video a folder poseppl-NAME, new, with these, N being a camera's number:
  camera_N.mp4             what it saw; camera_N/000000.png and on are the same without loss (--lossless)
  camera_N_visible.npz     pixels that show the person: keys masks (packed bits) and shape (frames, height, width)
  camera_N_whole.npz       pixels that would show the person if there were no furniture
  camera_N_background.png  the empty room; camera_N_occluder.png: its furniture, which may hide the person, a gray a piece
  Calib.toml               the cameras; image points have their origin in the centre of the first pixel
  truth.csv, truth.nc      true places of the markers in mm; the second has the body's states, too
  scene.toml               what the scene was made of
Inputs are never overwritten.

\b
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


_OF_SUBJECT = ("skeleton", "names", "lengths", "model", "frames", "rate", "scale", "up")
_OF_CAMERAS = ("camera", "cameras", "camera_distance", "view", "noise")


@click.command(epilog=EXAMPLES, short_help="Write 2-D observations of a motion, or videos.")
@click.argument("recording", required=False, type=InputFile())
@option_group(*options_of(RecordingSettings, *_OF_SUBJECT))
@click.option(
    "--turn",
    metavar="MM",
    type=number("at least 300 mm, or -300 and below to turn right", lambda radius: abs(radius) >= 300),
    help="Lay the walk along a circle of this radius on the floor: to the left, or to the right with -MM; at least 300. Poses "
    "are unchanged, so feet on the floor turn with the body. [default: as recorded]",
)
@option_group(*options_of(RecordingSettings, *_OF_CAMERAS))
@click.option(
    "--focal",
    metavar="PIXELS",
    type=number("1 to 1000000 pixels", lambda focal: 1 <= focal <= 1e6),
    help="Focal length of placed cameras. [default: 1500; a view of 70 degrees with --video]",
)
@click.option(
    "--size",
    metavar="W H",
    type=number("1 to 100000 pixels", lambda side: 1 <= side <= 100_000, click.INT),
    nargs=2,
    default=None,
    help="Width and height of the images of placed cameras, px. [default: 1920 1080; 640 480 with --video]",
)
@click.option(
    "--missing",
    metavar="FRACTION",
    type=number("a fraction from 0 to below 1", lambda missing: 0 <= missing < 1),
    default=0.0,
    show_default=True,
    help="Fraction of the markers that are not seen, at random.",
)
@seed_option("Seed of the noise, and of the room.")
@click.option(
    "--video",
    is_flag=True,
    help="Render videos instead: a clothed person in a room with a camera in every corner (--cameras, 4 by default). Needs "
    "pip install 'poseppl[render]'.",
)
@click.option(
    "--clutter/--no-clutter",
    default=None,
    help="Whether a table and chairs stand in the way of a video's cameras. [default: --clutter]",
)
@click.option("--lossless", is_flag=True, help="Write every frame of a video as a PNG file, too.")
@click.option(
    "--output",
    "-o",
    metavar="DIR|FILE.csv",
    help="File of the points; with --video a new folder. [default: poseppl-NAME.csv, here; poseppl-NAME]",
)
@common_options
def simulate(recording: str | None, **options: Any) -> None:
    """See a motion through simulated cameras: write noisy 2-D markers, or videos of a person with that motion.

    RECORDING is a motion capture file (.bvh, .c3d, .trc; .amc, DeepMimic's or exponential maps' .txt with --skeleton);
    without it, the built-in walk is seen.
    """
    if options["video"]:
        simulate_video(recording, options)
        return
    for name, given in (("clutter", options["clutter"] is not None), ("lossless", options["lossless"])):
        if given:
            raise InputError("this is of videos", field=f"--{name}", expected="--video with it")
    options["focal"] = 1500.0 if options["focal"] is None else options["focal"]
    options["size"] = options["size"] or (1920, 1080)
    _simulate_points(recording, options)


def _simulate_points(recording: str | None, options: dict[str, Any]) -> None:
    from poseppl.cli.checks import check_writable, output_path, stem_of
    from poseppl.cli.console import ConsoleProgress, print_table, start_jax

    settings = made(RecordingSettings, options | {"recording": recording})
    check_recording(recording, options["skeleton"])
    check_inputs()
    points = output_path(options["output"], stem_of(recording), ".csv")
    camera, truth = points.with_suffix(".toml"), points.with_suffix(".nc")
    check_writable([points, camera, truth], [recording, options["skeleton"], options["camera"]])

    from poseppl.motion.io import read_cameras, write_cameras, write_observations
    from poseppl.motion.recordings.subjects import cameras_of, subject_of
    from poseppl.motion.recordings.truth import save_truth
    from poseppl.motion.tracking import observe_motion
    from poseppl.motion.tracking.observations import observations_of_scene
    from poseppl.motion.tracking.placing import cameras_of_records, records_of_cameras

    start_jax()
    subject = subject_of(settings, options["turn"])
    for note in subject.notes:
        ConsoleProgress(options["quiet"]).note(Phrase(f"{recording}: ", note))
    cameras, names = cameras_of(settings, subject)
    if options["camera"] is not None:
        records = read_cameras(options["camera"])
    else:
        records = records_of_cameras(cameras, options["focal"], options["size"])
        cameras = cameras_of_records(records)
    scene = observe_motion(subject, cameras, names, noise=options["noise"], missing=options["missing"], seed=options["seed"])
    write_observations(points, observations_of_scene(scene))
    write_cameras(camera, records)
    save_truth(scene, truth)
    if not options["quiet"]:
        rows = [("frames", str(len(scene.frames))), ("points", str(points)), ("cameras", str(camera)), ("truth", str(truth))]
        print_table("poseppl simulate", rows)


def simulate_video(recording: str | None, options: dict[str, Any]) -> None:
    """Render a subject in a room and write the folder of the scene.

    Args:
        recording: The motion capture file; the built-in walk if None.
        options: Options of the command.

    Raises:
        InputError: An option or an input cannot be used.
        PosepplError: A package or OpenGL is missing, or the disk is full.
    """
    from poseppl.cli.checks import check_inputs, check_recording, stem_of
    from poseppl.cli.console import ConsoleProgress, print_table, start_jax

    folder = _folder(options["output"], stem_of(recording))
    _refuse(options)
    settings = made(RecordingSettings, options | {"recording": recording, "cameras": None, "noise": None})
    check_recording(recording, options["skeleton"])
    check_inputs()

    from poseppl.motion.io.opencv import opencv
    from poseppl.motion.recordings.subjects import subject_of
    from poseppl.motion.recordings.truth import film_subject
    from poseppl.motion.rendering import SensorNoise, build_setting
    from poseppl.motion.rendering.render import check_noise, load_mujoco

    noise = SensorNoise() if options["noise"] is None else SensorNoise(level=options["noise"])
    check_noise(noise)
    load_mujoco()
    opencv()
    start_jax()
    progress = ConsoleProgress(options["quiet"], doing="rendering")
    subject = subject_of(settings, options["turn"])
    for note in subject.notes:
        progress.note(Phrase(f"{recording}: ", note))
    setting = build_setting(
        subject.body.tree.marker_names,
        subject.complete_markers(),
        toes=_toes(recording, options),
        clutter=options["clutter"] is not False,
        cameras=4 if options["cameras"] is None else options["cameras"],
        size=options["size"] or (640, 480),
        focal=options["focal"],
        seed=options["seed"],
    )
    with progress.running():
        progress.stage("rendering", setting.num_frames)
        film_subject(folder, subject, setting, noise=noise, lossless=options["lossless"], advance=progress.advance)
    if not options["quiet"]:
        cameras = f"{len(setting.cameras)} of {setting.size[0]} x {setting.size[1]} pixels"
        furniture = ", ".join(piece.kind for piece in setting.furniture) or "none"
        rows = [("frames", f"{setting.num_frames} at {subject.rate:g} Hz"), ("cameras", cameras), ("furniture", furniture)]
        print_table("poseppl simulate", [*rows, ("scene", str(folder))])


def _folder(given: str | None, stem: str) -> Path:
    folder = Path(stem if given is None else given)
    if folder.exists() or folder.is_symlink():
        raise InputError("the output exists", file=folder, field="--output", expected="the name of a new folder")
    if not folder.absolute().parent.is_dir():
        raise InputError("the output folder does not exist", file=folder.parent, expected="an existing folder")
    return folder


def _refuse(options: dict[str, Any]) -> None:
    for name in ("camera", "camera_distance", "view"):
        if options[name] is not None:
            field = "--" + name.replace("_", "-")
            raise InputError("a video's cameras hang in the corners of the room", field=field, expected="no --video with it")
    if options["missing"]:
        raise InputError("a video has no markers that could be missing", field="--missing", expected="no --video with it")


def _toes(recording: str | None, options: dict[str, Any]) -> dict[str, Any]:
    """The toes of a recording, which the body that is tracked does not have."""
    from poseppl.motion.io import read_motion
    from poseppl.motion.recordings.subjects import chosen_motion
    from poseppl.motion.rendering import find_toes
    from poseppl.motion.tracking.default_body import DEFAULT_MODEL

    if recording is None:
        return {}
    asked = {name: options[name] for name in ("rate", "scale", "up")}
    motion = read_motion(recording, options["skeleton"], **asked)
    chosen = (options[name] for name in ("frames", "names", "turn"))
    return find_toes(chosen_motion(motion, options["model"] or DEFAULT_MODEL, *chosen))
