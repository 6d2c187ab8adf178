"""`poseppl track FILE...` without a source: which source the files are, by their content and by what else is given.

>>> dispatched(["walk.bvh", "--cameras", "2"])
['recording', 'walk.bvh', '--cameras', '2']
>>> dispatched(["--video", "cam1.mp4", "--calibration", "c.toml"])
['videos', 'cam1.mp4', '--calibration', 'c.toml']
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path

BY_OPTION = {"--keypoints": "keypoints", "--video": "videos", "--observations": "observations"}
"""Sources of files that stand after an option; it may be left out."""
_VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm")
_PICTURES = (".png", ".jpg", ".jpeg")
_ROWS = 4
"""Largest number of lines of a table before its first frame."""


def dispatched(words: Sequence[str], flags: Sequence[str] = ()) -> list[str]:
    """The same words after the command of their source.

    Args:
        words: Arguments after `poseppl track`, without a source.
        flags: Options that take no value.
    """
    source, files, rest = None, list[str](), list[str]()
    named = ""
    for word in words:
        option, equals, value = word.partition("=")
        if option in BY_OPTION:
            source = source or BY_OPTION[option]
            word = value if equals else ""
        if word:
            is_option = word.startswith("-") and len(word) > 1
            files += [word] if not is_option and not named else []
            named = word if is_option and "=" not in word and word not in flags else ""
            rest.append(word)
    source = source or (source_of_file(files[0]) if files else "recording")
    if source == "keypoints":
        source = _of_keypoints(files, rest)
        rest = [word for word in rest if word != "--live"]
    return [source, *rest]


_KEYPOINTS = (".json", ".jsonl", ".csv", ".tsv", ".h5", ".hdf5", ".slp", ".npz", ".npy", ".pkl", ".pickle", ".parquet")
"""Endings of files that may be a detector's; any other single file is a recording, or none that is known."""


def source_of_file(word: str) -> str:
    """The source of a file, or of CAMERA=FILE."""
    given, _, after = word.partition("=")
    of_camera = bool(after) and not os.path.exists(word)
    path = Path(after if of_camera else word)
    if path.is_dir():
        names = sorted(os.listdir(path))
        pictures = any(name.lower().endswith(_PICTURES) for name in names)
        return "videos" if pictures or "scene.toml" in names else "keypoints"
    suffix = path.suffix.lower()
    if suffix in _VIDEOS:
        return "videos"
    if suffix == ".csv" and path.is_file():
        header = _header(path)[0]
        return "observations" if {"marker", "x", "y"} <= set(header) else "keypoints"
    if of_camera or (path.is_file() and suffix in _KEYPOINTS):
        return "keypoints"
    return "recording"


def _of_keypoints(files: Sequence[str], words: Sequence[str]) -> str:
    """Whether keypoints are of a person, still to come, or of anything else, each a point by itself."""
    paths = [word.partition("=")[2] for word in files]
    skeleton = any(option == "--skeleton" for option in (word.partition("=")[0] for word in words))
    if skeleton or (paths and all(map(is_point_table, paths))):
        return "points"
    return "live" if "--live" in words else "keypoints"


def is_point_table(path: str) -> bool:
    """Whether a file is a table of points of which none is a person's."""
    if Path(path).suffix.lower() != ".csv" or not Path(path).is_file():
        return False
    header = _header(Path(path))
    if "sync_index" in header[0]:
        return True
    names = [row[1:] for row in header if row[0] == "bodyparts"]
    if not names:
        return False
    from poseppl.motion.io.keypoint_layouts import markers_of_names

    return not markers_of_names(tuple(dict.fromkeys(names[0])))


def _header(path: Path) -> list[list[str]]:
    """The first rows of a table, at least one."""
    with suppress(OSError), path.open(encoding="utf-8", errors="replace") as lines:
        return [[field.strip() for field in line.split(",")] for line in islice(lines, _ROWS)] or [[""]]
    return [[""]]
