"""How large a person is: the segment lengths of the standard subject in proportion to a stature, and lengths from a file.

thigh = 435.0
shank = 420.0
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl.errors import FilePath, InputError, Location
from poseppl.files.bounded_reading import read_toml
from poseppl.motion.bodies.body import body_builder
from poseppl.motion.io.text_parsing import finite_numbers

STATURE = 1750.0
"""Of the standard subject, mm."""
POPULATION = (1692.0, 92.0)
"""Mean and standard deviation, mm, of the stature of somebody of whom nothing is known: an adult, as likely a man (1756 +- 69)
as a woman (1629 +- 64; Gordon et al. 2014, *2012 Anthropometric Survey of U.S. Army Personnel*, NATICK/TR-15/007)."""


def stature_lengths(model: str, stature: float) -> dict[str, float]:
    """Segment lengths (mm) of the standard subject in proportion.

    Args:
        model: Builder of the body.
        stature: mm.

    Raises:
        InputError: It is no person's.
    """
    if not 500.0 <= stature <= 2500.0:
        raise InputError(f"{stature:g} mm", field="--stature", expected="500 to 2500 mm")
    standard = body_builder(model)(None).lengths
    return {name: value * stature / STATURE for name, value in standard.items()}


def read_lengths(path: FilePath, model: str) -> dict[str, float]:
    """Read segment lengths (mm) from a TOML file.

    Args:
        path: The file: lines such as ``thigh = 435.0``.
        model: Builder of the body, whose segments they are.

    Raises:
        InputError: The file is no TOML, or holds another name or something that is no length.
    """
    table = read_toml(path)
    lengths = finite_numbers(table, body_builder(model)(None).lengths, Location(path, field="--lengths"))
    for name, value in lengths.items():
        if abs(value) > 3000.0:
            raise InputError(f"{value:g} mm", file=path, field=name, expected="at most 3000 mm")
    return lengths


def subject_lengths(
    model: str, stature: float | None, path: FilePath | None, known: Mapping[str, float] | None = None
) -> Mapping[str, float] | None:
    """Lengths as a stature and a file tell them, the file first; otherwise those that are known, if any.

    Raises:
        InputError: As :func:`stature_lengths` and :func:`read_lengths`.
    """
    if stature is not None:
        known = stature_lengths(model, stature)
    return known if path is None else {**(known or {}), **read_lengths(path, model)}
