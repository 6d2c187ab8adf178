"""From options to a subject in front of cameras."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from poseppl.cli.options import OF_PLACED_CAMERAS, chosen
from poseppl.errors import InputError


def find_subject(recording: str | None, options: dict[str, Any], note: Callable[[str], None]) -> Any:
    """The recorded subject, or the one that walks; its scale, rate, frames and circle as the options say.

    Args:
        recording: The file, or None.
        options: Of the command.
        note: Prints what the file's reader assumed.
    """
    from poseppl.motion.tracking import recorded_subject, walking_subject
    from poseppl.motion.tracking.subjects import DEFAULT_MODEL

    model = options["model"] or DEFAULT_MODEL
    if options["scale"] is not None and not 0 < options["scale"] < 1e6:
        raise InputError(f"{options['scale']:g}", field="--scale", expected="a positive number of millimetres")
    rate = given_rate(options)
    if recording is None:
        for name in ("skeleton", "scale", "up", "names", "lengths"):
            if options[name] is not None:
                raise InputError("the built-in walk takes none", field=f"--{name}", expected="a recording with it")
        return walking_subject(model, frames=options["frames"], rate=rate, turn=options.get("turn"))
    subject = recorded_subject(
        recording,
        options["skeleton"],
        model=model,
        rate=rate,
        turn=options.get("turn"),
        **chosen(options, "frames", "scale", "up", "names", "lengths"),
    )
    for told in subject.notes:
        note(f"{recording}: {told}")
    return subject


def given_rate(options: dict[str, Any]) -> float | None:
    """Frames a second, where the options tell."""
    rate: float | None = options["rate"]
    if rate is not None and not 0 < rate < 1e6:
        raise InputError(f"{rate:g}", field="--rate", expected="a positive number of frames a second")
    return rate


def look_at_subject(subject: Any, options: dict[str, Any]) -> tuple[Any, tuple[str, ...]]:
    """Cameras and their names: from a file, or placed around the subject."""
    from poseppl.motion.io import read_cameras
    from poseppl.motion.tracking.placing import camera_names, cameras_around, cameras_of_records

    placed = {name: given for name, given in chosen(options, *OF_PLACED_CAMERAS).items() if given is not None}
    if options["camera"] is not None:
        for name in placed:
            raise InputError("cameras come from the file", field="--" + name.replace("_", "-"), expected="no --camera with it")
        records = read_cameras(options["camera"])
        return cameras_of_records(records), tuple(record.name for record in records)
    count = placed.get("cameras", 1)
    distance, view = placed.get("camera_distance", 5000.0), placed.get("view", 90.0)
    return cameras_around(subject, distance=distance, count=count, view=view), camera_names(count)


def stem_of(recording: str | None, person: int | None = None) -> str:
    """Name of the outputs; another one for each person of a recording."""
    stem = "poseppl-walk" if recording is None else f"poseppl-{Path(recording).stem}"
    return stem if person in (None, 1) else f"{stem}-person{person}"
