"""Implementation of `poseppl simulate --video`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from poseppl.cli.options import made
from poseppl.errors import InputError, Phrase
from poseppl.motion.recordings.settings import RecordingSettings


def simulate_video(recording: str | None, options: dict[str, Any]) -> None:
    """Render a subject in a room and write the folder of the scene.

    Args:
        recording: The motion capture file; the built-in walk if None.
        options: Options of the command.

    Raises:
        InputError: An option or an input cannot be used.
        PosepplError: A package or OpenGL is missing, or the disk is full.
    """
    from poseppl.cli.checks import check_inputs, check_recording
    from poseppl.cli.console import ConsoleProgress, print_table, start_jax
    from poseppl.cli.files import stem_of

    folder = _folder(options["output"], stem_of(recording))
    _refuse(options)
    settings = made(RecordingSettings, options | {"recording": recording, "cameras": None, "noise": None})
    check_recording(recording, options["skeleton"])
    check_inputs()

    from poseppl.motion.io.opencv import opencv
    from poseppl.motion.recordings.subject_video import film_subject
    from poseppl.motion.recordings.subjects import subject_of
    from poseppl.motion.rendering import SensorNoise, build_setting
    from poseppl.motion.rendering.noise import check_noise
    from poseppl.motion.rendering.packages import load_mujoco

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
