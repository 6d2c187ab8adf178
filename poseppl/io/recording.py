"""One door to the motion capture formats: the suffix of a file tells which reader it gets."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from poseppl.errors import InputError
from poseppl.io.amc import CMU_RATE, read_amc
from poseppl.io.asf import read_asf
from poseppl.io.bvh import read_bvh
from poseppl.io.c3d import read_c3d
from poseppl.io.deepmimic import read_deepmimic
from poseppl.io.motion import Motion

SUFFIXES = (".amc", ".bvh", ".c3d", ".txt")


def read_motion(
    path: str | PathLike[str],
    skeleton: str | PathLike[str] | None = None,
    *,
    rate: float | None = None,
    scale: float | None = None,
    up: str | None = None,
) -> Motion:
    """Read a motion capture recording.

    Args:
        path: A .amc, .bvh or .c3d file, or a .txt motion of DeepMimic.
        skeleton: The .asf file that belongs to an .amc file; DeepMimic's character.
        rate: Frames a second of an .amc file, which does not tell it; 120 by default.
        scale: Millimetres a unit of a .bvh file, which does not tell it; guessed from the skeleton's height by default.
        up: The axis that points up in a .bvh or .c3d file, "x", "y" or "z"; found in the file by default.

    Returns:
        The motion, Z up, in mm.

    Raises:
        InputError: The file is missing, malformed, of an unknown format or without its skeleton.
        PosepplError: The format needs a package that is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"unknown format {suffix!r}", file=path, expected=" or ".join(SUFFIXES))
    if suffix == ".amc":
        if skeleton is None:
            raise InputError("an .amc file needs its skeleton", file=path, expected="--skeleton FILE.asf, or FILE.amc,FILE.asf")
        if rate is not None and not 0.0 < rate < 1e6:
            raise InputError(f"{rate:g} frames a second", field="rate", expected="a positive number")
        return read_amc(path, read_asf(skeleton), rate=CMU_RATE if rate is None else rate)
    if suffix == ".txt":
        if skeleton is None:
            expected = "--skeleton humanoid3d.txt, or FILE.txt,humanoid3d.txt"
            raise InputError("a DeepMimic motion needs its character", file=path, expected=expected)
        return read_deepmimic(path, skeleton)
    if skeleton is not None:
        raise InputError(f"a {suffix} file takes no skeleton", file=path, field="skeleton")
    if up is not None and up not in ("x", "y", "z"):
        raise InputError(f"{up!r} is no axis", field="up", expected="x, y or z")
    return read_bvh(path, scale=scale, up=up) if suffix == ".bvh" else read_c3d(path, up=up)
