"""A result in the files that biomechanists' programs read.

=========  =========================================================================================================
``trc``    ``NAME.trc``, ``NAME_lower.trc``, ``NAME_upper.trc``: mean places of the joints, and the ends of the interval
           of each coordinate; mm, Y up
``mot``    ``NAME.mot``: mean joint angles under OpenSim's names (:mod:`poseppl.motion.bodies.opensim`), degrees and m, Y
           up; its header says what each is
``osim``   ``NAME.osim``: a model of OpenSim with the person's lengths, the coordinates of the MOT, and the joints of the
           TRC as markers (:mod:`poseppl.motion.tracking.opensim_model`)
``bvh``    ``NAME.bvh``: mean motion of a rig, for Blender and Unity (:mod:`poseppl.motion.tracking.rig`)
``c3d``    ``NAME.c3d``: mean places, mm, Z up, the root of the summed variances of x, y and z as residual
``csv``    ``NAME.csv``: a row a frame and coordinate, of places (mm, Y up, as the TRC) and of angles
``rrd``    ``NAME.rrd``: poses, draws, cameras and images over time, for rerun (:mod:`poseppl.motion.io.rerun_writing`)
=========  =========================================================================================================

Times are those of the frames' numbers: frame 0 is at 0 s. Markers and angles that no camera saw
(:mod:`poseppl.motion.bodies.unseen`) come from the prior alone. TRC and MOT leave them out, C3D has a gap, CSV has 0 in the
column ``seen``, rrd draws nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from poseppl_models.bodies.named_points import points_in_cameras

from poseppl.arrays import Booleans, Floats
from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.atomic_writing import write_rows
from poseppl.files.exchange_formats import files_of
from poseppl.motion.bodies.body import name_of_builder
from poseppl.motion.bodies.opensim import Coordinate
from poseppl.motion.bodies.unseen import Unseen
from poseppl.motion.io.c3d import write_c3d
from poseppl.motion.io.motion import Motion, y_up
from poseppl.motion.io.opensim_files import write_mot
from poseppl.motion.io.rerun_writing import write_rerun
from poseppl.motion.io.trc import write_trc
from poseppl.motion.tracking.estimates import Clock, Estimates, angle_estimates, clock_of, place_estimates, unseen_of
from poseppl.motion.tracking.opensim_model import write_model
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.motion.tracking.rig import Rig, write_rig
from poseppl.runs.results import provenance

COLUMNS = ("frame", "time", "joint", "coordinate", "unit", "mean", "lower", "upper", "sd", "seen")
"""Columns of the CSV file."""


class Exported(NamedTuple):
    """Exported content of a result.

    Attributes:
        clock: Its frames in time.
        names: K names of joints.
        places: Their places (T, K, 3), mm, Z up.
        coordinates: Definitions of the angles.
        angles: Their values (T, coordinates), degrees and m.
        source: Source of the result.
        unseen: Those of them that no camera saw.
    """

    clock: Clock
    names: Sequence[str]
    places: Estimates
    coordinates: Sequence[Coordinate]
    angles: Estimates
    source: str
    unseen: Unseen

    def motion(self, positions: Floats) -> Motion:
        """Places (T, K, 3) as a motion, NaN where unseen."""
        shown = np.where(self.seen_markers[:, None], positions, np.nan)
        return Motion(tuple(self.names), shown, (), self.clock.rate, self.source)

    @property
    def seen_markers(self) -> Booleans:
        """(K,)."""
        return np.array([name not in self.unseen.markers for name in self.names])

    @property
    def seen_coordinates(self) -> Booleans:
        """(coordinates,)."""
        return np.array([each.name not in self.unseen.coordinates for each in self.coordinates], bool)


def export(
    tree: xr.DataTree,
    folder: FilePath,
    stem: str,
    formats: Sequence[str] = ("trc", "mot"),
    *,
    level: float = 0.9,
    model: str | None = None,
    rig: Rig = "mixamo",
    unit: str = "cm",
) -> list[Path]:
    """Write a result for other programs.

    Args:
        tree: A result of points or silhouettes, of a filter or smoothed.
        folder: Folder of the files.
        stem: NAME, of the files.
        formats: Some of trc, mot, osim, bvh, c3d, csv and rrd.
        level: Level of the intervals.
        model: Builder of the body; needed for angles where the result's own is not installed.
        rig: Names of the joints of bvh: poseppl, mixamo or blender.
        unit: Unit of its lengths: mm, cm or m.

    Returns:
        The files.

    Raises:
        InputError: A format is unknown, the level is no share, the result holds no joints, its model cannot be built, or angles
            are asked of points without a body.
        PosepplError: The disk is full, or a package is missing.
    """
    if {"mot", "osim", "bvh"} & set(formats) and not has_angles(tree):
        raise InputError("named points have no joint angles", field=Argument("format"), expected="trc, c3d, csv or rrd")
    files = files_of(folder, stem, formats)
    names, places = place_estimates(tree, level)
    angular = has_angles(tree) and not _ANGULAR.isdisjoint(formats)
    none = Estimates(*[np.zeros((len(places.mean), 0))] * 4)
    coordinates, angles = angle_estimates(tree, level, model) if angular else ((), none)
    source = str(provenance(tree).get("input", ""))
    exported = Exported(clock_of(tree), names, places, coordinates, angles, source, unseen_of(tree))
    for name, paths in files.items():
        if name == "rrd":
            write_rerun(paths[0], tree, exported.clock.times, exported.unseen.markers)
        elif name == "bvh":
            write_rig(paths[0], tree, rig, unit, model)
        elif name == "osim":
            markers = [marker for marker in names if marker not in exported.unseen.markers]
            write_model(paths[0], recorded_model(tree, model).body, stem, markers)
        else:
            _WRITERS[name](exported, paths)
    return [path for paths in files.values() for path in paths]


def usual_formats(tree: xr.DataTree, model: str | None = None) -> tuple[str, ...]:
    """Write the default formats; arguments and errors are those of :func:`export`."""
    if not has_angles(tree):
        return ("trc",)
    return ("trc", "mot", "osim") if recorded_model(tree, model).body.segments else ("trc", "mot")


def has_angles(tree: xr.DataTree) -> bool:
    """Whether a result is one of a body, with joint angles, rather than of points."""
    return provenance(tree).get("model") != name_of_builder(points_in_cameras)


def _write_trc(exported: Exported, paths: Sequence[Path]) -> None:
    clock, seen = exported.clock, exported.seen_markers
    names = tuple(name for name, kept in zip(exported.names, seen, strict=True) if kept)
    for path, positions in zip(paths, _corners(exported.places), strict=True):
        write_trc(path, Motion(names, positions[:, seen], (), clock.rate, exported.source), clock.times, clock.frames)


def _corners(places: Estimates) -> tuple[Floats, Floats, Floats]:
    """Means and ends (T, K, 3), Z up, as they are the ends where Y is up: its third axis is the second one turned round."""
    lower, upper = places.lower.copy(), places.upper.copy()
    lower[..., 1], upper[..., 1] = places.upper[..., 1], places.lower[..., 1]
    return places.mean, lower, upper


def _write_mot(exported: Exported, paths: Sequence[Path]) -> None:
    seen = [(k, each) for k, each in enumerate(exported.coordinates) if each.name not in exported.unseen.coordinates]
    columns = {each.name: exported.angles.mean[:, k] for k, each in seen}
    left_out = [f"No camera saw {name}, which is left out." for name in exported.unseen.coordinates]
    write_mot(paths[0], exported.clock.times, columns, [*(each.description for _, each in seen), *left_out])


def _write_c3d(exported: Exported, paths: Sequence[Path]) -> None:
    spread = np.linalg.norm(exported.places.spread, axis=-1)
    write_c3d(paths[0], exported.motion(exported.places.mean), spread, exported.clock.frames)


def _write_csv(exported: Exported, paths: Sequence[Path]) -> None:
    write_rows(paths[0], [COLUMNS, *_rows(exported)])


def _rows(exported: Exported) -> Iterator[list[object]]:
    places = (*(y_up(values) for values in _corners(exported.places)), np.abs(y_up(exported.places.spread)))
    keys = [(joint, axis, "mm") for joint in exported.names for axis in "xyz"]
    keys += [(each.joints[-1], each.name, each.unit) for each in exported.coordinates]
    seen = [*np.repeat(exported.seen_markers, 3), *exported.seen_coordinates]
    values = np.stack(
        [np.concatenate([of.reshape(len(of), -1), at], 1) for of, at in zip(places, exported.angles, strict=True)], -1
    )
    for frame, time, numbers in zip(exported.clock.frames, exported.clock.times, values.tolist(), strict=True):
        for names, row, known in zip(keys, numbers, seen, strict=True):
            yield [int(frame), f"{time:.9g}", *names, *(f"{value:.6g}" for value in row), int(known)]


_WRITERS: dict[str, Callable[[Exported, Sequence[Path]], None]] = {
    "trc": _write_trc,
    "mot": _write_mot,
    "c3d": _write_c3d,
    "csv": _write_csv,
}
_ANGULAR = {"mot", "csv"}
"""Formats that hold angles, too."""
