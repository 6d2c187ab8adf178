"""A result as a recording for the viewer of rerun, through the library rerun-sdk: poses in space and in the images, over time.

=============================  =====================================================================================
``world/mean``, ``skeleton``   mean places of the joints, by name, and the lines between them; mm, Z up
``world/draws``                skeletons of some draws
``world/truth``                where there is one
``world/cameras/NAME``         each camera; below it ``observed`` and ``mean``, points in its image
=============================  =====================================================================================

Timelines are ``frame``, and ``time`` in seconds where frame 0 is at 0 s. Lenses are shown as if they did not distort; a camera
whose image is upside down (a negative focal length) has its image in ``images/NAME`` instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.diagnostics.selection import Array, some_draws
from poseppl.errors import FilePath, InputError, PosepplError
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.measures import edges, mean_points
from poseppl.runs.contents import arrays_of, frame_numbers, names_of, variable

NUM_DRAWS = 10
MEAN, DRAW, OBSERVED, TRUTH = (31, 111, 139), (109, 179, 201, 120), (228, 87, 46), (150, 150, 150)


def write_rerun(path: FilePath, tree: xr.DataTree, times: Floats, unseen: Sequence[str] = ()) -> None:
    """Write a recording.

    Args:
        path: The .rrd file, overwritten if it exists.
        tree: A result with markers.
        times: (T,) of its frames, seconds.
        unseen: Markers that are not drawn.

    Raises:
        InputError: The result has no markers, or the file cannot be written.
        PosepplError: rerun-sdk is not installed, or the disk is full.
    """
    try:
        import rerun
    except ImportError as error:
        raise PosepplError("rerun-sdk is not installed: pip install 'poseppl[rerun]'") from error
    mean = variable(tree, "summary", "markers_mean")
    if mean is None:
        raise InputError("the result has no markers", file=path, expected="a result of points or of a body")
    hidden = np.isin(names_of(tree, "marker", "summary"), list(unseen))[:, None]
    mean = np.where(hidden, np.nan, mean)
    with atomic_path(path) as temporary:
        recording = rerun.RecordingStream("poseppl", send_properties=False)
        recording.save(temporary)
        recording.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        places = _log_cameras(rerun, recording, tree)
        space = {"draws": _shown(some_draws(tree, "markers", NUM_DRAWS), hidden), "truth": variable(tree, "truth", "markers")}
        image = {"observed": variable(tree, "observed_data", "points"), "mean": mean_points(tree)}
        for number, (frame, time) in enumerate(zip(frame_numbers(tree), times, strict=True)):
            recording.set_time("frame", sequence=int(frame))
            recording.set_time("time", duration=float(time))
            _log_pose(rerun, recording, tree, mean[number], {name: _at(name, of, number) for name, of in space.items()})
            for camera, place in enumerate(places):
                for name, points in image.items():
                    if points is not None:
                        shown = _known(points[number, camera])
                        recording.log([*place, name], rerun.Points2D(shown, colors=OBSERVED if name == "observed" else MEAN))
        recording.flush()
        recording.disconnect()


def _shown(draws: Array | None, hidden: Array) -> Array | None:
    return None if draws is None else np.where(hidden, np.nan, draws)


def _log_pose(rerun: Any, recording: Any, tree: xr.DataTree, mean: Array, beside: dict[str, Any]) -> None:
    names, pairs = np.array(names_of(tree, "marker", "summary")), edges(tree)
    seen = np.isfinite(mean).all(-1)
    recording.log(
        "world/mean", rerun.Points3D(mean[seen], labels=names[seen].tolist(), show_labels=False, colors=MEAN, radii=12.0)
    )
    recording.log("world/skeleton", rerun.LineStrips3D(_strips(mean, pairs), colors=MEAN, radii=6.0))
    if beside["draws"] is not None:
        strips = np.concatenate([_strips(draw, pairs) for draw in beside["draws"]])
        recording.log("world/draws", rerun.LineStrips3D(strips, colors=DRAW, radii=2.0))
    if beside["truth"] is not None:
        recording.log("world/truth", rerun.LineStrips3D(_strips(beside["truth"], pairs), colors=TRUTH, radii=5.0))


def _log_cameras(rerun: Any, recording: Any, tree: xr.DataTree) -> list[list[str]]:
    """Log the cameras, and return where their images are."""
    lens = arrays_of(tree, "camera")
    places: list[list[str]] = []
    whole = {"rotation", "centre", "focal", "principal"} <= set(lens)
    points = mean_points(tree)
    for number, name in enumerate(names_of(tree, "camera") if points is not None else []):
        if not whole or (lens["focal"][number] <= 0).any():
            places.append(["images", name])
            continue
        places.append(["world", "cameras", name])
        turned = {"translation": lens["centre"][number], "mat3x3": lens["rotation"][number].T}
        recording.log(places[-1], rerun.Transform3D(**turned), static=True)
        focal, principal = lens["focal"][number], lens["principal"][number]
        size = np.maximum(2 * principal, 1.0)
        lens_shown = rerun.Pinhole(focal_length=focal, principal_point=principal, resolution=size, image_plane_distance=300.0)
        recording.log(places[-1], lens_shown, static=True)
    return places


def _at(name: str, values: Array | None, number: int) -> Array | None:
    """One frame of draws (sample, frame, ...) or of what has its frames first."""
    return None if values is None else values[:, number] if name == "draws" else values[number]


def _strips(places: Array, pairs: Array) -> Array:
    """Lines (edge, 2, axis) between markers that are known."""
    lines = places[pairs]
    return np.asarray(lines[np.isfinite(lines).all((-1, -2))])


def _known(points: Array) -> Array:
    return np.asarray(points[np.isfinite(points).all(-1)])
