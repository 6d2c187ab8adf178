"""From options to a subject in front of cameras."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from poseppl.cli.checks import check_recording
from poseppl.cli.options import OF_PLACED_CAMERAS, chosen
from poseppl.errors import InputError


def find_subject(recording: str | None, options: dict[str, Any], note: Callable[[str], None]) -> Any:
    """The recorded subject, or the one that walks; its scale, rate, frames and circle as the options say.

    Args:
        recording: The file, or None.
        options: Of the command.
        note: Prints what the file's reader assumed.
    """
    from poseppl.motion.recordings.subjects import recorded_subject, walking_subject
    from poseppl.motion.tracking.default_body import DEFAULT_MODEL

    model = options["model"] or DEFAULT_MODEL
    if recording is None:
        return walking_subject(model, turn=options.get("turn"), **chosen(options, "frames", "rate"))
    subject = recorded_subject(
        recording,
        options["skeleton"],
        model=model,
        turn=options.get("turn"),
        **chosen(options, "frames", "rate", "scale", "up", "names", "lengths"),
    )
    for told in subject.notes:
        note(f"{recording}: {told}")
    return subject


def check_subject(recording: str | None, options: dict[str, Any]) -> None:
    """Refuse options of a subject and its cameras that do not go together, before anything is imported for them.

    Raises:
        InputError: The built-in walk is given what only a recording has, a recording lacks its skeleton or is of no known
            format, placed cameras are given besides those of a file, or there is to be no noise.
    """
    check_recording(recording, options["skeleton"])
    for name in ("skeleton", "scale", "up", "names", "lengths") if recording is None else ():
        if options[name] is not None:
            raise InputError("the built-in walk takes none", field=f"--{name}", expected="a recording with it")
    for name, given in chosen(options, *OF_PLACED_CAMERAS).items() if options["camera"] is not None else ():
        if given is not None:
            raise InputError("cameras come from the file", field="--" + name.replace("_", "-"), expected="no --camera with it")
    check_noise(options)


def check_noise(options: dict[str, Any]) -> None:
    """Refuse points without noise; pictures may have none."""
    if options["noise"] == 0:
        raise InputError("0", field="--noise", expected="a positive fraction of the focal length, such as 0.003")


def look_at_subject(subject: Any, options: dict[str, Any]) -> tuple[Any, tuple[str, ...]]:
    """Cameras and their names: from a file, or placed around the subject."""
    from poseppl.motion.io import read_cameras
    from poseppl.motion.tracking.placing import camera_names, cameras_around, cameras_of_records

    placed = {name: given for name, given in chosen(options, *OF_PLACED_CAMERAS).items() if given is not None}
    if options["camera"] is not None:
        records = read_cameras(options["camera"])
        return cameras_of_records(records), tuple(record.name for record in records)
    count = placed.get("cameras", 1)
    distance, view = placed.get("camera_distance", 5000.0), placed.get("view", 90.0)
    return cameras_around(subject, distance=distance, count=count, view=view), camera_names(count)


def stem_of(recording: str | None, person: int | None = None) -> str:
    """Name of the outputs; another one for each person of a recording."""
    stem = "poseppl-walk" if recording is None else f"poseppl-{Path(recording).stem}"
    return stem if person in (None, 1) else f"{stem}-person{person}"
