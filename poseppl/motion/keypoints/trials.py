"""Trials in a folder: the keypoints of several cameras each, found by their names, and the calibration that goes with them.

A trial is a folder that has files or folders named as cameras of its calibration, itself or in a folder ``pose``. The
calibration is the nearest one: in the trial's folder, or in the one around it, and so on. It is a file whose name contains
"calib", or one in a folder that is called so.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from poseppl.errors import Argument, FilePath, InputError
from poseppl.motion.io.cameras import read_cameras
from poseppl.motion.io.names import folded
from poseppl.motion.io.text_parsing import some

KEYPOINTS = (".json", ".csv", ".h5", ".hdf5", ".npy")
"""How names of a detector's files end."""
_CALIBRATIONS = (".toml", ".xml", ".txt", ".xcp", ".mcal")
_MORE = re.compile("(json|keypoints|pose|dlc.*)$")
"""Endings that programs add to a camera's name."""
_PLAIN = ("pose", "keypoints")
"""Folders of a trial's cameras that do not name it."""


class Trial(NamedTuple):
    """A trial.

    Attributes:
        name: Its folder, within the folder of all, as POSIX has it.
        files: Keypoints by the names of their cameras.
        calibration: The cameras.
        absent: Cameras of the calibration without keypoints.
        problem: Why it cannot be used; empty if it can.
    """

    name: str
    files: Mapping[str, Path]
    calibration: Path
    absent: tuple[str, ...] = ()
    problem: str = ""


class Found(NamedTuple):
    """Contents of a folder.

    Attributes:
        trials: The trials, by name.
        passed_over: Folders with files of keypoints that are no trial, and why.
    """

    trials: list[Trial]
    passed_over: list[tuple[Path, str]]


def find_trials(folder: FilePath, calibration: FilePath | None = None) -> Found:
    """Find trials.

    Args:
        folder: The folder of all.
        calibration: The cameras of all trials; the nearest calibration of each if None.

    Raises:
        InputError: There is no such folder or no trial in it, a calibration cannot be read, or two are equally near.
    """
    top = Path(folder)
    if not top.is_dir():
        raise InputError("no such folder", file=top, expected="a folder of trials, or the folder of one")
    given = None if calibration is None else Path(calibration)
    found = Found([], [])
    for each in _visit(top, given, given is None, {}):
        if isinstance(each, Trial):
            found.trials.append(each._replace(name=_name(Path(each.name), top)))
        else:
            found.passed_over.append(each)
    if not found.trials:
        reasons = [f"{where}: {why}" for where, why in found.passed_over[:3]]
        problem = "there is no trial in it" + (f" ({'; '.join(reasons)})" if reasons else "")
        raise InputError(problem, file=top, expected="folders with keypoints named as the cameras of the calibration")
    return found


def _name(own: Path, top: Path) -> str:
    if own.name.lower() in _PLAIN and own != top:
        own = own.parent
    return top.resolve().name if own == top else own.relative_to(top).as_posix()


def _visit(
    folder: Path, calibration: Path | None, seek: bool, known: dict[Path, tuple[str, ...]]
) -> Iterator[Trial | tuple[Path, str]]:
    """Trials in a folder, given the calibration of the one around it, and the cameras of known ones."""
    calibration = (_calibration_in(folder) if seek else None) or calibration
    inside = [each for each in sorted(folder.iterdir()) if not each.name.startswith(".") and each != calibration]
    folders = [each for each in inside if each.is_dir()]
    files = [each for each in inside if each.suffix.lower() in KEYPOINTS and each.is_file()]
    if calibration is None:
        if files:
            yield folder, "no calibration in it or around it (a name with calib in it)"
    else:
        if calibration not in known:
            known[calibration] = tuple(record.name for record in read_cameras(calibration))
        trial = _trial(folder, [*folders, *files], calibration, known[calibration])
        if trial is not None:
            yield trial
            return
        if files:
            names, cameras = (some(each, 4) for each in ([file.stem for file in files], known[calibration]))
            yield folder, f"no file is named as a camera of {calibration.name} ({cameras}): {names}"
    for each in folders:
        if not (seek and "calib" in each.name.lower()):
            yield from _visit(each, calibration, seek, known)


def _trial(folder: Path, entries: list[Path], calibration: Path, cameras: tuple[str, ...]) -> Trial | None:
    """The trial of a folder; None if nothing in it is named as a camera."""
    names = match_cameras([each.name if each.is_dir() else each.stem for each in entries], cameras)
    own = [(camera, entry) for camera, entry in zip(names, entries, strict=True) if camera is not None]
    if not own:
        return None
    chosen = dict(sorted(own, key=lambda pair: cameras.index(pair[0])))
    absent = tuple(camera for camera in cameras if camera not in chosen)
    if len(chosen) < len(own):
        twice = next(camera for camera in chosen if [name for name, _ in own].count(camera) > 1)
        problem = f"{some([entry.name for camera, entry in own if camera == twice])} are all of the camera {twice}"
    elif len(chosen) < 2:
        problem = f"one camera alone, {next(iter(chosen))}: two or more are needed (poseppl track keypoints takes one)"
    else:
        problem = ""
    return Trial(str(folder), chosen, calibration, absent, problem)


def match_cameras(names: list[str], cameras: tuple[str, ...]) -> list[str | None]:
    """The camera that each name is of, None of none: without case, punctuation, leading zeros and what programs add.

    >>> match_cameras(["cam01_json", "Cam_2DLC_resnet50", "videos"], ("cam_01", "cam_02"))
    ['cam_01', 'cam_02', None]
    """
    plain = [_plain(camera) for camera in cameras]
    table = {name: camera for name, camera in zip(plain, cameras, strict=True) if plain.count(name) == 1}
    return [name if name in cameras else table.get(_plain(name)) for name in names]


def _plain(name: str) -> str:
    words = re.sub(r"(?<!\d)0+(?=\d)", "", folded(name))
    return _MORE.sub("", words) or words


def _calibration_in(folder: Path) -> Path | None:
    """The calibration that is in a folder, or in one of it that is called so; None if there is none.

    Raises:
        InputError: There are several.
    """
    named = [each for each in sorted(folder.iterdir()) if "calib" in each.name.lower() and not each.name.startswith(".")]
    found = [each for each in named if each.is_file() and each.suffix.lower() in _CALIBRATIONS]
    for each in named:
        if each.is_dir():
            inside = [file for file in sorted(each.iterdir()) if file.suffix.lower() in _CALIBRATIONS]
            found += inside or ([each] if any(each.glob("*.y*ml")) or any(each.glob("*.pickle")) else [])
    if len(found) > 1:
        expected = "one calibration in a folder; another name for the others"
        raise InputError(
            f"{some([each.name for each in found])} are calibrations",
            file=folder,
            field=Argument("calibration"),
            expected=expected,
        )
    return found[0] if found else None
