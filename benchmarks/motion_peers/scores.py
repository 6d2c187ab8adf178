"""Input of libraries from the recording, and scores of their output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from given import SETS, Given, set_name, write_given
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import DATA, show
from poseppl.cli.console import start_jax
from poseppl.motion.geometry import project
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from studies.balancing import read_triangulation
from studies.keypoints import RATE, adjusted_cameras, coverage, held, places_of, scene_of

ALL = (1, 2, 3, 4)
COLUMNS = (
    "cameras",
    "library",
    "method",
    "median",
    "percentile_95",
    "own_median",
    "own_percentile_95",
    "published",
    "held_out",
    "held_out_95",
    "missing",
    "coverage_50",
    "coverage_90",
    "joints_50",
    "joints_90",
    "first_seconds",
    "seconds",
)
MARKERS = markers_of_names(LAYOUTS["body25b"])
LENS = ("matrix", "distortion", "rotation", "translation", "size")
PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
PUBLISHED = {
    "skull": "Neck",
    "crown": "Head",
    **{f"{part}_{side.lower()}": side + part.title() for side in "LR" for part in PARTS},
}
"""The joints, and what the published triangulation calls them."""


class Found(NamedTuple):
    """An answer that was read: its place (T, K, 3), draws or None, seconds, and whose it is."""

    library: str
    method: str
    places: Any
    draws: Any
    seconds: list[float]


def data_folder() -> Path:
    """Folder of the recording."""
    return DATA / "pose2sim_balancing"


def joints_of(found: KeypointScene) -> list[int]:
    """Numbers of the joints among the body's markers."""
    return [found.scene.body.tree.marker_names.index(name) for name in PUBLISHED]


def give(output: Path, *, quick: bool) -> None:
    """Write what the libraries are given, for each set of cameras."""
    start_jax()
    records = adjusted_cameras(data_folder())
    for cameras in SETS[:1] if quick else SETS:
        found = scene_of(data_folder(), cameras, "0:30" if quick else None)
        data, index = found.scene.data, joints_of(found)
        seen = [np.asarray(each)[:, :, index] for each in (data.points, found.confidence, data.noise)]
        lenses = [np.stack([getattr(records[c - 1], name) for c in cameras]) for name in LENS]
        layout = [MARKERS[name] for name in PUBLISHED]
        rest = (np.array(each) for each in (cameras, list(PUBLISHED), layout, RATE))
        write_given(output, Given(*seen, *lenses, *rest))


def read_answers(output: Path, cameras: Sequence[int]) -> list[Found]:
    """The answers for a set of cameras, of all libraries that gave one."""
    found = []
    for path in sorted((output / "answers").glob(f"*-[0-9]-{set_name(cameras)}.npz")):
        with np.load(path) as stored:
            if stored["cameras"] != set_name(cameras):  # the pattern takes 1-2-4 for 2-4, too
                continue
            draws = stored["draws"].astype(np.float64) if "draws" in stored else None
            found.append(Found(str(stored["library"]), str(stored["method"]), stored["places"], draws, list(stored["seconds"])))
    return found


def of_all(places: Any, full: KeypointScene) -> Any:
    """Joints (..., K, 3) among all markers (..., M, 3), NaN for the others."""
    every = np.full((*places.shape[:-2], len(full.scene.body.tree.marker_names), 3), np.nan)
    every[..., joints_of(full), :] = places
    return every


def distances(places: Any, full: KeypointScene, camera: int) -> Any:
    """How far (T, K), px, a camera's keypoints are from the projections of places (T, K, 3)."""
    lens = jax.tree.map(lambda leaf: leaf[camera : camera + 1], full.scene.cameras)
    image = np.asarray(project(lens, jnp.asarray(places, float)), np.float64)[0]
    return np.linalg.norm(full.scene.data.points[:, camera, joints_of(full)] - image, axis=-1)


def two(values: Any) -> tuple[float, float]:
    """Median and 95th percentile of what is finite."""
    known = values[np.isfinite(values)]
    return (float(np.median(known)), float(np.quantile(known, 0.95))) if known.size else (np.nan, np.nan)


def predicted(found: Found, left_out: Sequence[int], full: KeypointScene, known: Any) -> tuple[float, ...]:
    """Score keypoints in held-out cameras: median and 95th percentile of the error, 50 and 90 % coverage."""
    errors = [np.where(known, distances(found.places, full, camera), np.nan) for camera in left_out]
    rng, shares = np.random.default_rng(0), []
    if found.draws is not None:
        draws = of_all(found.draws, full)
        shares = [coverage(draws, full, camera, rng) for camera in left_out]
    return (*two(np.concatenate(errors)), *held(shares)[:2])


def joints_held(draws: Any, reference: Any) -> tuple[float, float]:
    """Shares of the reference's coordinates in the 50 and 90 % intervals of draws."""
    if draws is None:
        return np.nan, np.nan
    seen, shares = np.isfinite(reference), []
    for level in (0.5, 0.9):
        low, high = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
        shares.append(float(((reference >= low) & (reference <= high))[seen].mean()))
    return shares[0], shares[1]


def rows_of(output: Path, cameras: tuple[int, ...], full: KeypointScene, published: Any) -> list[tuple[Any, ...]]:
    """A row for each method, of one set of cameras."""
    answers = read_answers(output, cameras)
    reference = places_of(full)[:, joints_of(full)]
    known = np.isfinite(np.stack([each.places for each in answers])).all((0, -1))
    left_out = [camera - 1 for camera in ALL if camera not in cameras]
    rows = []
    for each in answers:
        error = np.linalg.norm(each.places - reference, axis=-1)
        from_published = np.linalg.norm(each.places - published, axis=-1)
        missing = float(1 - np.isfinite(each.places).all(-1).mean())
        error_2d, error_2d_95, *shares = predicted(each, left_out, full, known)
        numbers = (*two(error[known]), *two(error), two(from_published[known])[0], error_2d, error_2d_95, missing, *shares)
        seconds = (*each.seconds, np.nan)[:2]
        rows.append((set_name(cameras), each.library, each.method, *numbers, *joints_held(each.draws, reference), *seconds))
    return rows


def score(output: Path, *, quick: bool) -> None:
    """Print the table and write OUTPUT/motion_peers.csv."""
    start_jax()
    count = 30 if quick else 100
    full = scene_of(data_folder(), ALL, f"0:{count}")
    triangulation = read_triangulation(data_folder() / "reference" / "Balancing_for_IK.trc", count)
    published = np.stack([triangulation[name] for name in PUBLISHED.values()], 1)
    rows: list[tuple[Any, ...]] = []
    for cameras in SETS[:1] if quick else SETS:
        rows += rows_of(output, cameras, full, published)
    table = Table("motion_peers", COLUMNS, rows)
    cells = [[value if isinstance(value, str) else f"{value:.3g}" for value in row] for row in table.rows]
    show(f"{count} frames", table.columns, cells)
    write_csv(table, output)
