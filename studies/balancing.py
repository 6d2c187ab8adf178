"""A man on a beam, tracked in silhouettes of four, two and one calibrated cameras: error and overlap.

    POSEPPL_DATA=FOLDER python -m studies.balancing [--quick] [--frames 100] [--filters assumed-density,annealed]
        [--cameras 4,2,1] [--runs 1] [--videos]

Recording: pose2sim_balancing. Masks are the published ones at half resolution, or come from the videos and pictures of the
empty room (--videos). The start is found in the silhouettes; the camera that he faces is given.

Errors are against the published triangulation of all cameras, mm: the mean distance of 12 joints, and the same relative to the
middle of the hips. The triangulation is no exact truth: its segments vary by centimetres. Overlap is the intersection over
union of the mean pose's silhouette and the published masks, every tenth frame, in the cameras that were not used (in all, if
all were used). --result FILE.nc reads a result of `poseppl track videos` instead of tracking. Runs differ in their seed: the
table has means, and the standard deviation of the error. The random walk is 15 mm and 0.15 radians a frame, at 60 Hz.
"""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from poseppl_models.bodies.silhouettes import choo_fleet_flesh, full_body

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.coverage import hard_coverage, part_distances, project_parts
from poseppl.motion.geometry.flesh import flesh_of, parts_of
from poseppl.motion.io import CameraRecord, read_cameras, read_image
from poseppl.motion.silhouettes.data import SilhouetteData
from poseppl.motion.silhouettes.scene import silhouette_scene
from poseppl.motion.silhouettes.video_sources import see_silhouettes, sources_of_files
from poseppl.motion.tracking import TrackSettings, track
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.scene import Scene
from poseppl.runs.results import load_result, provenance

STATURE = 1730.0
"""Stature of the man, mm, from the thighs and shanks of the triangulation."""
RATE = 60.0
WALK = {"sigma_position": 15.0 * RATE**0.5, "sigma_angle": 0.15 * RATE**0.5}
"""15 mm and 0.15 radians a frame."""
VIEWS = {(0, 1, 2, 3): 1, (0, 2): 0, (0,): 0}
"""Cameras that are used, and the one of them that the man faces."""
_JOINTS = {
    f"{joint}_{side}": f"{long}{word}"
    for side, long in (("r", "R"), ("l", "L"))
    for joint, word in (
        ("hip", "Hip"),
        ("knee", "Knee"),
        ("ankle", "Ankle"),
        ("shoulder", "Shoulder"),
        ("elbow", "Elbow"),
        ("wrist", "Wrist"),
    )
}
_STRIDE = 4


def main() -> None:
    options = arguments(
        __doc__, frames=100, filters="assumed-density,annealed", cameras="4,2,1", runs=1, videos=False, result=""
    )
    start_jax()
    folder = DATA / "pose2sim_balancing"
    count = 10 if options.quick else options.frames
    records, masks, occlusion = read_masks(folder, count)
    reference, rows = read_triangulation(folder / "reference" / "Balancing_for_IK.trc", count), []
    looks = (view for view in VIEWS if str(len(view)) in options.cameras.split(","))
    if options.videos:
        scenes = (seen_in_videos(folder, records, view, count) for view in looks)
    else:
        scenes = (scene_of(records, masks, occlusion, view) for view in looks)
    results = [load_result(options.result)] if options.result else runs(scenes, options.filters.split(","), options.runs)
    for tree in results:
        rows.append(measured(tree, reference, records, masks))
        print(*rows[-1][:2], *(f"{value:.3g}" for value in rows[-1][2:]), flush=True)
    columns = ["filter", "cameras", "error, mm", "relative, mm", "overlap", "frames/s"]
    show(f"{count} frames", columns, [summed(name, list(same)) for name, same in itertools.groupby(rows, lambda row: row[:2])])


def runs(scenes: Iterator[Scene[SilhouetteData]], filters: Sequence[str], number: int) -> Iterator[xr.DataTree]:
    """Results of so many runs of all filters on all scenes."""
    for scene in scenes:
        for name in filters:
            for seed in range(number):
                yield track(scene, TrackSettings(filter=name, seed=seed, **WALK)).result
            jax.clear_caches()  # programs of many filters together are more than a process may map


def summed(name: tuple[str, str], rows: Sequence[tuple[Any, ...]]) -> list[str]:
    """The row of runs that differ in their seed."""
    error, relative, overlap, rate = zip(*(row[2:] for row in rows), strict=True)
    spread = f" ± {statistics.stdev(error):.0f}" if len(rows) > 1 else ""
    means = [f"{statistics.mean(relative):.0f}", f"{statistics.mean(overlap):.2f}", f"{statistics.median(rate):.2f}"]
    return [*name, f"{statistics.mean(error):.0f}{spread}", *means]


def measured(tree: xr.DataTree, reference: dict[str, Any], records: list[CameraRecord], masks: Any) -> tuple[Any, ...]:
    """Row of one result: filter, number of cameras, error, relative error, overlap, frames a second."""
    summary, known = tree["summary"].dataset, provenance(tree)
    used = [str(name) for name in summary["camera"].values]
    error, relative = errors([str(name) for name in summary["marker"].values], summary["markers_mean"].values, reference)
    others = [camera for camera, record in enumerate(records) if record.name not in used] or list(range(len(records)))
    overlap = mean_overlap(full_body(known["lengths"]), summary["state_mean"].values, records, masks, others)
    rate = len(summary["frame"]) / known["wall_seconds"]
    return known["filter"], str(len(used)), error, relative, overlap, rate


def read_masks(folder: Path, count: int) -> tuple[list[CameraRecord], dict[str, Any], dict[str, Any]]:
    """Half-size cameras, their masks (T, H, W), and what is unknown."""
    records, masks, occlusion = [], {}, {}
    for number, record in enumerate(read_cameras(folder / "calibration" / "Calib_qualisys.toml"), start=1):
        with np.load(folder / "silhouettes" / f"cam{number:02d}_masks_half.npz") as stored:
            width = int(stored["shape"][-1])
            masks[record.name] = np.unpackbits(stored["masks"][:count], axis=-1, count=width)
        matrix = record.matrix.copy()
        matrix[:2] /= 2
        matrix[:2, 2] += 0.25 - 0.5  # centres of pixels at whole numbers in both sizes
        records.append(record._replace(matrix=matrix, size=masks[record.name].shape[:0:-1]))
        unknown = folder / "silhouettes" / f"cam{number:02d}_unknown_half.png"
        if unknown.is_file():
            occlusion[record.name] = read_image(unknown)[..., 0]
    return records, masks, occlusion


def scene_of(records: list[CameraRecord], masks: Any, occlusion: Any, view: tuple[int, ...]) -> Scene[SilhouetteData]:
    """The published masks of some cameras."""
    standard = full_body().lengths
    body = full_body({name: value * STATURE / 1750.0 for name, value in standard.items()})
    chosen = [records[camera] for camera in view]
    nowhere = np.zeros((1, 1), np.uint8)
    believed = {record.name: masks[record.name] * (occlusion.get(record.name, nowhere) == 0) for record in chosen}
    seen = silhouette_scene(body, chosen, believed, occlusion=occlusion, rate=RATE)
    return seen._replace(data=seen.data._replace(facing=records[VIEWS[view]].name))


def seen_in_videos(folder: Path, records: list[CameraRecord], view: tuple[int, ...], count: int) -> Scene[SilhouetteData]:
    """Scene from the videos of some cameras, as `poseppl track videos` finds it."""
    named = [(records[camera].name, f"cam{camera + 1:02d}") for camera in view]
    videos = [f"{name}={folder / 'videos' / file}.mp4" for name, file in named]
    plates = [f"{name}={folder / 'silhouettes' / file}_background_half.png" for name, file in named]
    sources = sources_of_files(videos, folder / "calibration" / "Calib_qualisys.toml", plates=plates)
    return see_silhouettes(sources, stature=STATURE, facing=records[VIEWS[view]].name, stop=count)


def read_triangulation(path: Path, count: int) -> dict[str, Any]:
    """Places (T, 3) of the joints, mm; the file's x, y, z are the world's y, z, x, in metres."""
    lines = path.read_text().splitlines()
    names = [word for word in lines[3].split("\t")[2:] if word.strip()]
    rows = [line.split("\t")[2 : 2 + 3 * len(names)] for line in lines[5:] if line.strip()][:count]
    places = 1000.0 * np.array([[float(word) if word.strip() else np.nan for word in row] for row in rows])
    return {name: places.reshape(len(rows), -1, 3)[:, number][:, [2, 0, 1]] for number, name in enumerate(names)}


def errors(names: Sequence[str], found: Any, reference: dict[str, Any]) -> tuple[float, float]:
    """Mean distance and relative distance, mm, of joints (T, markers, 3)."""
    ours = np.stack([found[:, names.index(name)] for name in _JOINTS], 1)
    theirs = np.stack([reference[name] for name in _JOINTS.values()], 1)
    hips = [list(_JOINTS).index(name) for name in ("hip_r", "hip_l")]
    relative = (ours - ours[:, hips].mean(1, keepdims=True)) - (theirs - theirs[:, hips].mean(1, keepdims=True))
    return tuple(float(np.nanmean(np.linalg.norm(each, axis=-1))) for each in (ours - theirs, relative))  # type: ignore[return-value]


def mean_overlap(body: Body, states: Any, records: list[CameraRecord], masks: Any, cameras: list[int]) -> float:
    """Intersection over union of silhouettes, on every fourth pixel of every tenth frame."""
    shares = []
    flesh = flesh_of(body.tree, choo_fleet_flesh(body.lengths))
    for camera in cameras:
        record, mask = records[camera], masks[records[camera].name][:, ::_STRIDE, ::_STRIDE]
        rows, columns = np.mgrid[: record.size[1] : _STRIDE, : record.size[0] : _STRIDE]
        points = jnp.asarray(np.stack([columns, rows], -1).reshape(1, -1, 2), float)

        def covered(tree: Any, flesh: Any, state: Any, cameras: Any, points: Any) -> Any:
            return hard_coverage(part_distances(project_parts(cameras, flesh, parts_of(tree, flesh, state)), points))

        draw = jax.jit(batch_last(covered))
        for frame in range(0, len(states), 10):
            ours = np.asarray(draw(body.tree, flesh, jnp.asarray(states[frame], float), cameras_of_records([record]), points))
            theirs = mask[frame].ravel() != 0
            shares.append(np.sum(ours[0] & theirs) / max(1, np.sum(ours[0] | theirs)))
    return float(np.mean(shares))


if __name__ == "__main__":
    main()
