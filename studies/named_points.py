"""Named points on real recordings: a camera that was held out, and distances that are known.

    POSEPPL_DATA=FOLDER python -m studies.named_points [--quick] [--part fly|board] [--output DIR]

fly_legs: twelve points of a fly's legs in two of three cameras are smoothed, and the third camera's points (confidence above
0.9) are compared with their predictions: median error of a coordinate, px; coverage of 50 and 90 % intervals; mean log score of
a coordinate. Networks are three, each by itself, and the median of all. Nothing is fitted on the camera that is held out: how
much worse it is than the others is drawn from the prior. Linear triangulation stands beside it, without intervals.

charuco_board: the corners of a board from two, three and four cameras, each corner by itself; the distances between them are
known. Errors in mm, and how often intervals of the distances hold.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.named_points import CAMERA_SCALE, clutter_log_odds, noise_scales
from poseppl_papers.tables import Table, write_csv
from scipy.stats import norm

from benchmarks.timing import DATA, arguments, show
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.motion.geometry import depth, project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import read_cameras
from poseppl.motion.points.files import read_point_recording
from poseppl.motion.points.named_points import FREEDOM, PointRecording, logits
from poseppl.motion.points.settings import PointSettings
from poseppl.motion.points.smoothing import PointTracks, smooth_points

CAMERAS, NETWORKS = ("Cam-A", "Cam-B", "Cam-C"), (0, 1, 2)
SURE = 0.9
SPACING = 54.0
"""Distance of neighbouring corners, mm."""
_ROWS = 3


class Score(NamedTuple):
    """Predictions of a held-out camera: error px, shares of coordinates in intervals, mean log score."""

    median: float
    percentile_95: float
    coverage_50: float
    coverage_90: float
    log_score: float


def fly(folder: Path, network: int | None, frames: str | None) -> PointRecording:
    """Detections of a network, or the median of all."""
    if network is None:
        each = [fly(folder, number, frames) for number in NETWORKS]
        middle = np.median([one.points for one in each], 0)
        return each[0]._replace(points=middle, confidence=np.mean([one.confidence for one in each], 0))
    files = {name: next(folder.glob(f"*{name}*rng={network}.csv")) for name in CAMERAS}
    return read_point_recording(PointSettings(files, read_cameras(folder / "calibration.toml"), frames=frames))


def images(recording: PointRecording, tracks: PointTracks) -> Floats:
    """Draws (S, T, K, 2) of where one camera sees the points."""
    lens = tracks.frame.cameras(recording.cameras)
    local = tracks.frame.to_local(tracks.places)
    return np.stack([np.asarray(project(lens, jnp.asarray(place, float)), np.float64)[0] for place in local])


def foretell(recording: PointRecording, tracks: PointTracks, seed: int = 0) -> tuple[Floats, Floats, Floats]:
    """Draws (S, T, K, 2) of where a camera sees points, variances (S, T, K) of errors, probabilities (T, K) of clutter."""
    deep = float(np.asarray(depth(recording.cameras, jnp.asarray(tracks.frame.origin, float)))[0])
    magnification = np.array([np.abs(np.asarray(recording.cameras.focal)).mean() / deep / tracks.frame.unit])
    sure, drawn, rng = logits(recording.confidence), images(recording, tracks), np.random.default_rng(seed)
    variance, clutter = np.empty(drawn.shape[:-1]), np.empty(drawn.shape[:-1])
    for s in range(len(drawn)):
        params = {name: values[s] for name, values in tracks.drawn_params.items()}
        params["camera"] = CAMERA_SCALE * rng.standard_normal(1)
        lasting, bias, other = (np.asarray(scale) for scale in noise_scales(params, magnification, sure))
        chi = rng.chisquare(FREEDOM, drawn.shape[1:-1]) / FREEDOM
        variance[s] = lasting[0] ** 2 + bias[0] ** 2 + other[:, 0] ** 2 / chi
        clutter[s] = 1 / (1 + np.exp(-np.asarray(clutter_log_odds(params, sure))[:, 0]))
    return drawn, variance, clutter.mean(0)


def score(recording: PointRecording, tracks: PointTracks) -> Score:
    """Judge points of one camera, each coordinate by the mixture of Gaussians that the draws make."""
    drawn, variance, clutter = foretell(recording, tracks)
    seen, wrong = recording.points[:, 0], clutter[..., None]
    below, density = np.zeros(seen.shape), np.zeros(seen.shape)
    for place, spread in zip(drawn, np.sqrt(variance)[..., None], strict=True):
        z = (seen - place) / spread
        below += norm.cdf(z) / len(drawn)
        density += norm.pdf(z) / spread / len(drawn)
    density = (1 - wrong) * density + wrong / recording.sizes[0]
    sure = (recording.confidence[:, 0] > SURE)[..., None] & np.isfinite(seen)
    error, off = np.abs(seen - drawn.mean(0))[sure], np.abs(below - 0.5)[sure]
    return Score(
        float(np.median(error)),
        float(np.quantile(error, 0.95)),
        float((off < 0.25).mean()),
        float((off < 0.45).mean()),
        float(np.log(density[sure]).mean()),
    )


def triangulated(whole: PointRecording, used: list[int], held: int) -> tuple[float, float]:
    """Median and 95th percentile of the error, px, of linear triangulation."""
    part, seen = whole.of_cameras(used), whole.of_cameras([held])
    places = triangulate(part.cameras, part.points, part.confidence)
    image = np.asarray(project(seen.cameras, jnp.asarray(places, float)), np.float64)[0]
    sure = (seen.confidence[:, 0] > SURE)[..., None] & np.isfinite(seen.points[:, 0])
    error = np.abs(seen.points[:, 0] - image)[sure]
    return float(np.median(error)), float(np.quantile(error, 0.95))


def fly_table(folder: Path, quick: bool) -> Table:
    """Rows by camera that is held out and by network."""
    rows: list[tuple[Any, ...]] = []
    for network, held in itertools.product((None, *NETWORKS), range(3)):
        if quick and (held, network) != (1, None):
            continue
        whole = fly(folder, network, "0:20" if quick else None)
        used = [camera for camera in range(3) if camera != held]
        found = score(whole.of_cameras([held]), smooth_points(whole.of_cameras(used)))
        label = "median of three" if network is None else str(network)
        rows.append((CAMERAS[held], label, *found, *triangulated(whole, used, held)))
        print(rows[-1], flush=True)
    columns = ("held_out", "network", *Score._fields, "linear_median", "linear_percentile_95")
    return Table("named_points_fly", columns, rows)


def board_distances(places: Floats) -> tuple[Floats, Floats]:
    """Distances (..., 36) between nine corners (..., 9, 3), and true ones (36,)."""
    first, second = np.triu_indices(_ROWS**2, 1)
    grid = np.stack(np.divmod(np.arange(_ROWS**2), _ROWS), -1) * SPACING
    return np.linalg.norm(places[..., first, :] - places[..., second, :], axis=-1), np.linalg.norm(
        grid[first] - grid[second], axis=-1
    )


def board_table(folder: Path, quick: bool) -> Table:
    """Rows by the cameras that are used; frames and corners count that all of them see."""
    records = read_cameras(folder / "camera_array.toml")
    files = {record.name: folder / "xy_CHARUCO.csv" for record in records}
    read, rows = read_point_recording(PointSettings(files, records)), []
    together = np.flatnonzero(np.isfinite(read.points).any((2, 3)).all(1))
    whole = read.of_frames(together)
    for count in (2, 3, 4):
        for used in itertools.combinations(range(4), count):
            if quick and used != (0, 1):
                continue
            part = whole.of_cameras(used)
            both = np.isfinite(part.points).all((1, 3))
            tracks = smooth_points(part)
            first, second = np.triu_indices(_ROWS**2, 1)
            pairs = both[:, first] & both[:, second]
            drawn, truth = board_distances(tracks.places)
            linear, _ = board_distances(triangulate(part.cameras, part.points, part.confidence))
            below = (drawn < truth).mean(0)[pairs]
            error, other = (np.abs(found - truth)[pairs] for found in (np.median(drawn, 0), linear))
            held = [float((np.abs(below - 0.5) < level / 2).mean()) for level in (0.5, 0.9)]
            names = " ".join(part.camera_names)
            worst = [float(np.quantile(values, 0.95)) for values in (error, other)]
            rows.append(
                (names, count, int(pairs.sum()), float(np.median(error)), worst[0], *held, float(np.median(other)), worst[1])
            )
            print(rows[-1], flush=True)
    columns = ("cameras", "number", "distances", "median", "percentile_95", "coverage_50", "coverage_90")
    return Table("named_points_board", (*columns, "linear_median", "linear_percentile_95"), rows)


def main() -> None:
    """Print the tables and write them to OUTPUT."""
    options = arguments(__doc__, output="named_points", part="")
    folder = DATA
    start_jax()
    output = options.output
    parts = {"fly": (fly_table, "fly_legs"), "board": (board_table, "charuco_board")}
    for name, (make, place) in parts.items():
        if options.part in ("", name):
            table = make(folder / place, options.quick)
            cells = [[value if isinstance(value, str) else f"{value:.3g}" for value in row] for row in table.rows]
            show(table.name, table.columns, cells)
            write_csv(table, output)


if __name__ == "__main__":
    main()
