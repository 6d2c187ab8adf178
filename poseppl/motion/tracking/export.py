"""A result in the files that biomechanists' programs read.

=========  =========================================================================================================
``trc``    ``NAME.trc``, ``NAME_lower.trc``, ``NAME_upper.trc``: mean places of the joints, and the ends of the interval
           of each coordinate; mm, Y up
``mot``    ``NAME.mot``: mean joint angles under OpenSim's names (:mod:`poseppl.motion.bodies.opensim`), degrees and m, Y
           up; its header says what each is
``c3d``    ``NAME.c3d``: mean places, mm, Z up, the root of the summed variances of x, y and z as residual
``csv``    ``NAME.csv``: a row a frame and coordinate, of places (mm, Y up, as the TRC) and of angles
``rrd``    ``NAME.rrd``: poses, draws, cameras and images over time, for rerun (:mod:`poseppl.motion.io.rerun_writing`)
=========  =========================================================================================================

Times are those of the frames' numbers: frame 0 is at 0 s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from poseppl_models.bodies.named_points import points_in_cameras

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.atomic_writing import write_rows
from poseppl.files.exchange_formats import files_of
from poseppl.motion.bodies.body import name_of_builder
from poseppl.motion.bodies.opensim import Coordinate
from poseppl.motion.io.c3d_writing import write_c3d
from poseppl.motion.io.mot import write_mot
from poseppl.motion.io.motion import Motion, y_up
from poseppl.motion.io.rerun_writing import write_rerun
from poseppl.motion.io.trc import write_trc
from poseppl.motion.tracking.estimates import Clock, Estimates, angle_estimates, clock_of, place_estimates
from poseppl.runs.results import provenance

COLUMNS = ("frame", "time", "joint", "coordinate", "unit", "mean", "lower", "upper", "sd")
"""Of the CSV file."""


class Exported(NamedTuple):
    """What is written of a result.

    Attributes:
        clock: Its frames in time.
        names: K names of joints.
        places: Their places (T, K, 3), mm, Z up.
        coordinates: What the angles are.
        angles: Their values (T, coordinates), degrees and m.
        source: Where the result came from.
    """

    clock: Clock
    names: Sequence[str]
    places: Estimates
    coordinates: Sequence[Coordinate]
    angles: Estimates
    source: str

    def motion(self, positions: Floats) -> Motion:
        """Places (T, K, 3) as a motion."""
        return Motion(tuple(self.names), positions, (), self.clock.rate, self.source)


def export(
    tree: xr.DataTree,
    folder: FilePath,
    stem: str,
    formats: Sequence[str] = ("trc", "mot"),
    *,
    level: float = 0.9,
    model: str | None = None,
) -> list[Path]:
    """Write a result for other programs.

    Args:
        tree: A result of points or silhouettes, of a filter or smoothed.
        folder: Where the files go.
        stem: NAME, of the files.
        formats: Some of trc, mot, c3d, csv and rrd.
        level: Of the intervals.
        model: Builder of the body; needed for angles where the result's own is not installed.

    Returns:
        The files.

    Raises:
        InputError: A format is unknown, the level is no share, the result holds no joints, its model cannot be built, or angles
            are asked of points without a body.
        PosepplError: The disk is full, or a package is missing.
    """
    if "mot" in formats and not has_angles(tree):
        raise InputError("named points have no joint angles", field=Argument("format"), expected="trc, c3d, csv or rrd")
    files = files_of(folder, stem, formats)
    names, places = place_estimates(tree, level)
    angular = has_angles(tree) and not _ANGULAR.isdisjoint(formats)
    none = Estimates(*[np.zeros((len(places.mean), 0))] * 4)
    coordinates, angles = angle_estimates(tree, level, model) if angular else ((), none)
    source = str(provenance(tree).get("input", ""))
    exported = Exported(clock_of(tree), names, places, coordinates, angles, source)
    for name, paths in files.items():
        if name == "rrd":
            write_rerun(paths[0], tree, exported.clock.times)
        else:
            _WRITERS[name](exported, paths)
    return [path for paths in files.values() for path in paths]


def has_angles(tree: xr.DataTree) -> bool:
    """Whether a result is one of a body, with joint angles, rather than of points."""
    return provenance(tree).get("model") != name_of_builder(points_in_cameras)


def _write_trc(exported: Exported, paths: Sequence[Path]) -> None:
    clock = exported.clock
    for path, positions in zip(paths, _corners(exported.places), strict=True):
        write_trc(path, exported.motion(positions), clock.times, clock.frames)


def _corners(places: Estimates) -> tuple[Floats, Floats, Floats]:
    """Means and ends (T, K, 3), Z up, as they are the ends where Y is up: its third axis is the second one turned round."""
    lower, upper = places.lower.copy(), places.upper.copy()
    lower[..., 1], upper[..., 1] = places.upper[..., 1], places.lower[..., 1]
    return places.mean, lower, upper


def _write_mot(exported: Exported, paths: Sequence[Path]) -> None:
    columns = {each.name: exported.angles.mean[:, k] for k, each in enumerate(exported.coordinates)}
    write_mot(paths[0], exported.clock.times, columns, [each.told for each in exported.coordinates])


def _write_c3d(exported: Exported, paths: Sequence[Path]) -> None:
    spread = np.linalg.norm(exported.places.spread, axis=-1)
    write_c3d(paths[0], exported.motion(exported.places.mean), spread, exported.clock.frames)


def _write_csv(exported: Exported, paths: Sequence[Path]) -> None:
    write_rows(paths[0], [COLUMNS, *_rows(exported)])


def _rows(exported: Exported) -> Iterator[list[object]]:
    places = (*(y_up(values) for values in _corners(exported.places)), np.abs(y_up(exported.places.spread)))
    told = [(joint, axis, "mm") for joint in exported.names for axis in "xyz"]
    told += [(each.joints[-1], each.name, each.unit) for each in exported.coordinates]
    values = np.stack(
        [np.concatenate([of.reshape(len(of), -1), at], 1) for of, at in zip(places, exported.angles, strict=True)], -1
    )
    for frame, time, numbers in zip(exported.clock.frames, exported.clock.times, values.tolist(), strict=True):
        for names, row in zip(told, numbers, strict=True):
            yield [int(frame), f"{time:.9g}", *names, *(f"{value:.6g}" for value in row)]


_WRITERS: dict[str, Callable[[Exported, Sequence[Path]], None]] = {
    "trc": _write_trc,
    "mot": _write_mot,
    "c3d": _write_c3d,
    "csv": _write_csv,
}
_ANGULAR = {"mot", "csv"}
"""Formats that hold angles, too."""
