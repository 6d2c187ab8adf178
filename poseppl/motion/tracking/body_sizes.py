"""How large a person is: segment lengths in proportion to a stature, from a file, or measured in the places of markers.

thigh = 435.0
shank = 420.0
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Location
from poseppl.files.bounded_reading import read_toml
from poseppl.motion.bodies.body import Body, body_builder
from poseppl.motion.geometry import KinematicTree
from poseppl.motion.io.text_parsing import finite_numbers

STATURE = 1750.0
"""Stature of the standard subject, mm."""
POPULATION = (1692.0, 92.0)
"""Mean and standard deviation, mm, of the stature of somebody of whom nothing is known: an adult, as likely a man (1756 +- 69)
as a woman (1629 +- 64; Gordon et al. 2014, *2012 Anthropometric Survey of U.S. Army Personnel*, NATICK/TR-15/007)."""

_MIDDLES = {"pelvis": ("hip_l", "hip_r"), "neck": ("shoulder_l", "shoulder_r")}
"""Markers that are between two others where the detector has none."""


class MeasuredLengths(NamedTuple):
    """How a body's L lengths were measured, and what follows from them.

    Attributes:
        offsets: How the offsets of the body's tree change with each of its lengths, these with a leading axis.
        per_place: How lengths change with the places of its K markers (L, 3 K), moved by as much in all frames.
    """

    offsets: KinematicTree
    per_place: Floats


def stature_lengths(model: str, stature: float) -> dict[str, float]:
    """Segment lengths (mm) of the standard subject in proportion.

    Args:
        model: Builder of the body.
        stature: mm.

    Raises:
        InputError: It is no person's.
    """
    if not 500.0 <= stature <= 2500.0:
        raise InputError(f"{stature:g} mm", field=Argument("stature"), expected="500 to 2500 mm")
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
    lengths = finite_numbers(table, body_builder(model)(None).lengths, Location(path, field=Argument("lengths")))
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


def measured_lengths(body: Body, places: Floats) -> Mapping[str, float]:
    """Segment lengths (mm) in places of a body's markers (T, K, 3), mm, NaN where unseen.

    Raises:
        InputError: Markers that the body cannot do without are never seen.
    """
    seen = {name: places[:, k] for k, name in enumerate(body.tree.marker_names) if np.isfinite(places[:, k]).all(-1).any()}
    for name, (left, right) in _MIDDLES.items():
        if name not in seen and left in seen and right in seen:
            seen[name] = (seen[left] + seen[right]) / 2
    try:
        return body.measure(seen)
    except ValueError as error:
        raise InputError(
            f"the person's segments cannot be measured: {error}", field=Argument("stature"), expected="the person's height, mm"
        ) from error


def lengths_per_place(body: Body, places: Floats) -> Floats:
    """How a body's lengths as measured in places (T, K, 3) change with each (L, 3 K), moved by as much in all frames.

    Lengths of neighbours change together, and some by more than others: the middle of both hips is known better than the pelvis
    that it is compared with.

    Raises:
        InputError: As :func:`measured_lengths`.
    """
    steps = np.eye(3 * places.shape[1]).reshape(-1, *places.shape[1:])
    return np.stack([(_sizes(body, places + step) - _sizes(body, places - step)) / 2 for step in steps], 1)


def _sizes(body: Body, places: Floats) -> Floats:
    """Lengths (L,) as measured, in the body's order; its own where they are not."""
    return np.array(list({**body.lengths, **measured_lengths(body, places)}.values()))
