"""Image files that make a sequence: their order, and what is missing among them."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path

from poseppl.errors import FilePath
from poseppl.motion.io.opencv import place

SUFFIXES = frozenset((".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"))


def images_in(source: FilePath, camera: str) -> list[Path]:
    """List the images of a folder or of a pattern, in the order of the numbers in their names.

    Args:
        source: A folder, whose other files are passed over, or a pattern such as ``cam1/*.png``.
        camera: The camera, for messages.

    Returns:
        The paths.

    Raises:
        InputError: There is no image, a folder mixes several kinds, or a number is missing where the others are evenly spaced.
    """
    at = place(camera, file=source)
    if Path(source).is_dir():
        paths = [path for path in Path(source).glob("[!.]*") if path.suffix.lower() in SUFFIXES]
        kinds = sorted({path.suffix.lower() for path in paths})
        if len(kinds) > 1:
            expected = f"one kind; name it with a pattern, {Path(source) / ('*' + kinds[0])}"
            raise at.error(f"the folder has images of kinds {', '.join(kinds)}", expected)
    else:
        paths = [Path(name) for name in glob.glob(str(source)) if Path(name).is_file()]
    if not paths:
        raise at.error("no image", "files that end in " + ", ".join(sorted(SUFFIXES)))
    paths.sort(key=_natural_order)
    _check_numbers(source, camera, paths)
    return paths


def _natural_order(path: Path) -> list[tuple[int, int, str]]:
    parts = re.findall(r"\d+|\D+", path.name)
    return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts]


def _check_numbers(source: FilePath, camera: str, paths: Sequence[Path]) -> None:
    found = [re.findall(r"\d+", path.stem) for path in paths]
    if len(paths) < 3 or not all(found):
        return
    numbers = [int(digits[-1]) for digits in found]
    steps = [after - before for before, after in zip(numbers, numbers[1:], strict=False)]
    step = min(steps)
    if step < 1:
        return
    for frame, (number, width) in enumerate(zip(numbers, steps, strict=False)):
        if width != step:
            problem = f"no image with the number {number + step}, after {paths[frame].name}"
            expected = f"evenly spaced numbers, {numbers[0]}, {numbers[0] + step}, ..."
            raise place(camera, frame + 1, source).error(problem, expected)
