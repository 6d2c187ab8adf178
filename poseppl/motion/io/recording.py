"""One door to the motion capture formats: the suffix of a file tells which reader it gets."""

from __future__ import annotations

from pathlib import Path

from poseppl.errors import Argument, FilePath, Location, Phrase
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.amc import CMU_RATE, read_amc
from poseppl.motion.io.asf import read_asf
from poseppl.motion.io.bvh import read_bvh
from poseppl.motion.io.c3d import read_c3d
from poseppl.motion.io.json_skeletons import read_deepmimic, read_exponential_maps
from poseppl.motion.io.motion import Motion
from poseppl.motion.io.trc import read_trc
from poseppl.motion.io.units_and_axes import check_axis

SUFFIXES = (".amc", ".bvh", ".c3d", ".trc", ".txt")


def read_motion(
    path: FilePath,
    skeleton: FilePath | None = None,
    *,
    rate: float | None = None,
    scale: float | None = None,
    up: str | None = None,
) -> Motion:
    """Read a motion capture recording.

    Args:
        path: A .amc, .bvh, .c3d or .trc file, or a .txt motion of DeepMimic or of exponential maps.
        skeleton: The .asf file that belongs to an .amc file; DeepMimic's character; the .json file of exponential maps.
        rate: Frames a second of an .amc file or of exponential maps, which do not tell it; 120 by default.
        scale: Millimetres a unit of a .bvh file, which does not tell it; guessed from the skeleton's height by default.
        up: The axis that points up in a .bvh, .c3d or .trc file, one of `AXES`; found by default
            (:mod:`~poseppl.motion.io.units_and_axes`).

    Returns:
        The motion, Z up, in mm.

    Raises:
        InputError: The file is missing, malformed, of an unknown format or without its skeleton.
        PosepplError: The format needs a package that is not installed.
    """
    suffix, at = Path(path).suffix.lower(), Location(path)
    if suffix not in SUFFIXES:
        raise at.error(f"unknown format {suffix!r}", " or ".join(SUFFIXES))
    if rate is not None and not 0.0 < rate < 1e6:
        raise Location(field="rate").error(f"{rate:g} frames a second", "a positive number")
    if suffix in (".amc", ".txt"):
        return _read_with_skeleton(path, suffix, skeleton, CMU_RATE if rate is None else rate)
    if skeleton is not None:
        raise at.in_field("skeleton").error(f"a {suffix} file takes no skeleton")
    check_axis(up)
    if suffix == ".bvh":
        return read_bvh(path, scale=scale, up=up)
    return read_trc(path, up=up) if suffix == ".trc" else read_c3d(path, up=up)


def _read_with_skeleton(path: FilePath, suffix: str, skeleton: FilePath | None, rate: float) -> Motion:
    if suffix == ".amc":
        if skeleton is None:
            expected = Phrase(Argument("skeleton", "FILE.asf"), ", or FILE.amc,FILE.asf")
            raise Location(path).error("an .amc file needs its skeleton", expected)
        return read_amc(path, read_asf(skeleton), rate=rate)
    mimic = not read_text(path).lstrip().startswith(tuple("+-.0123456789"))
    if skeleton is None:
        wanted = "humanoid3d.txt" if mimic else "skeleton.json"
        problem = "a DeepMimic motion needs its character" if mimic else "exponential maps need their skeleton"
        raise Location(path).error(problem, Phrase(Argument("skeleton", wanted), f", or FILE.txt,{wanted}"))
    return read_deepmimic(path, skeleton) if mimic else read_exponential_maps(path, skeleton, rate=rate)
