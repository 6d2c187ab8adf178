"""Recorded walks as a detector's keypoints: errors of joints and angles, and coverage.

    POSEPPL_DATA=FOLDER python -m studies.simulated_keypoints [--quick] [--cameras 4,2] [--cases ...] [--recordings ...]
        [--output simulated-keypoints]

People of cmu_walks and opensim_mocap walk in the middle of a laboratory's four cameras (h36m_cameras), or of two that stand 43
degrees apart. Detections are drawn from the tracker's own programs (studies/laboratory_rig.py). Positions are beside the
joints, by 20 mm or not at all; errors are autocorrelated and have heavy tails. There are clutter, gaps, exchanged limbs, and
small errors of the cameras' poses. Tracking is that of `poseppl track keypoints ... --keep clocks`: cameras are refined, limbs
corrected, noise and segment lengths measured. Then come the filter of --filter and the smoother of autocorrelated errors. The
true values are the projected positions, and the angles, in OpenSim's definition, of the body that fits the recording. "aligned"
is after one rotation and shift of the whole recording, because the world is known only as well as the cameras. Keypoints
determine an angle if positions within 20 mm determine it to within 10 degrees; "ideal" is this precision. Runs in the tables in
OUTPUT are not made again.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_papers.tables import Table, shown, write_csv

from benchmarks.timing import DATA, arguments
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.motion.bodies.opensim import Coordinate, opensim_coordinates, opensim_values
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import marker_positions
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.drawn_detections import LAYOUT, Detected, detect
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, track
from poseppl.motion.tracking.estimates import Estimates, angle_estimates, place_estimates
from poseppl.motion.tracking.lasting_errors import SHIFT
from studies.kept_runs import read_runs
from studies.laboratory_rig import RIG, placed_subject, rig_middle, rig_records

WALKS = ("05_01", "06_01", "07_01", "07_06", "08_01", "08_04", "16_15", "16_47", "35_05", "35_28", "35_33")
OPENSIM = "walking1"
FRAMES, STEP = 60, 4
"""Frames of cmu_walks at 120 Hz: two seconds of its middle, at 30 Hz."""
CASES: Mapping[str, Mapping[str, Any]] = {
    "all": {},
    "no clutter": {"clutter": False},
    "at the joints": {"clutter": False, "beside": 0.0},
}
"""Which errors the points have: all, all but clutter, and none that is beside the joints either."""
LEVELS = (0.5, 0.9)
PLACES = "places"
"""Name of the rows of joints' positions, beside those of angles."""
COLUMNS = ("recording", "cameras", "case", "what", "ideal", "median", "percentile_95", "coverage_50", "coverage_90", "width")
LIMBS = ("recording", "cameras", "case", "aligned", "exchanged", "found", "falsely", "pairs")


class Truth(NamedTuple):
    """True values to compare with a result, in its frames.

    Attributes:
        places: (T, K, 3) mm.
        angles: (T, coordinates) degrees and m.
        ideal: Median over frames of the standard deviation of each coordinate that ideal keypoints leave.
    """

    places: Floats
    angles: Floats
    ideal: Floats


def recorded(folder: Path, name: str, seed: int) -> MovingSubject:
    """A recorded person in the middle of the rig, heading anywhere."""
    heading = np.random.default_rng(seed).uniform(0, 2 * np.pi)
    middle = rig_middle(rig_records(folder))
    if name == OPENSIM:
        return placed_subject(folder / "opensim_mocap" / f"{name}.trc", None, "::3", middle, heading)
    file, skeleton = (folder / "cmu_walks" / each for each in (f"{name}.amc", f"{name[:2]}.asf"))
    total = sum(line.startswith("root") for line in file.read_text().splitlines())
    start = (total - FRAMES * STEP) // 2
    return placed_subject(file, skeleton, f"{start}:{start + FRAMES * STEP}:{STEP}", middle, heading)


def ideal_deviations(subject: MovingSubject) -> Floats:
    """Standard deviations of coordinates, median over frames, of a body whose keypoints are known within SHIFT, mm."""
    names = subject.body.tree.marker_names
    seen = jnp.array([names.index(name) for name in markers_of_names(LAYOUTS[LAYOUT]) if name in names])
    weak = np.where(np.arange(subject.body.tree.dimension) < 3, 1e-6, 1.0)  # a radian is known of each angle

    @jax.jit
    def deviation(x: Any) -> Any:
        places = jax.jacrev(lambda x: marker_positions(subject.body.tree, x)[seen].ravel())(x)
        values = jax.jacrev(lambda x: opensim_values(subject.body, x[None])[0])(x)
        covariance = jnp.linalg.inv(places.T @ places / SHIFT**2 + jnp.diag(jnp.asarray(weak, float)))
        return jnp.sqrt(jnp.einsum("ki,ij,kj->k", values, covariance, values))

    return np.median(np.stack([deviation(jnp.asarray(x, float)) for x in subject.states[::5]]), 0)


def truth_of(subject: MovingSubject, detected: Detected, frames: Any) -> Truth:
    """The truth in frames of a result."""
    angles = np.asarray(opensim_values(subject.body, jnp.asarray(subject.states, float)), np.float64)
    return Truth(detected.places[frames], angles[frames], ideal_deviations(subject))


def aligned(places: Floats, truth: Floats) -> Floats:
    """Places (T, K, 3) after the one turn and shift that bring them nearest to the truth."""
    ours, theirs = places.reshape(-1, 3), truth.reshape(-1, 3)
    u, _, v = np.linalg.svd((ours - ours.mean(0)).T @ (theirs - theirs.mean(0)))
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
    return np.asarray(((ours - ours.mean(0)) @ turn + theirs.mean(0)).reshape(places.shape))


def summed(error: Floats, inside: Sequence[Floats], width: Floats) -> tuple[float, ...]:
    """Median and 95th percentile of errors, shares inside of intervals, median width."""
    median, worst = np.quantile(error, [0.5, 0.95])
    return (float(median), float(worst), *(float(each.mean()) for each in inside), float(np.median(width)))


def place_row(found: Sequence[Estimates], truth: Floats, index: list[int]) -> tuple[float, tuple[float, ...]]:
    """Median aligned error, and the numbers of a row, of the joints that the detector has."""
    inside = [((truth >= each.lower) & (truth <= each.upper))[:, index] for each in found]
    last = found[-1]
    error = np.linalg.norm(last.mean - truth, axis=-1)[:, index]
    near = np.linalg.norm(aligned(last.mean[:, index], truth[:, index]) - truth[:, index], axis=-1)
    return float(np.median(near)), summed(error, inside, (last.upper - last.lower)[:, index])


def angle_rows(coordinates: Sequence[Coordinate], found: Sequence[Estimates], truth: Truth) -> list[tuple[Any, ...]]:
    """A row for each angle."""
    rows = []
    for k, coordinate in enumerate(coordinates):
        if coordinate.unit != "degrees":
            continue
        off = (truth.angles[:, k] - found[-1].mean[:, k] + 180) % 360 - 180
        inside = [(off >= (each.lower - each.mean)[:, k]) & (off <= (each.upper - each.mean)[:, k]) for each in found]
        width = (found[-1].upper - found[-1].lower)[:, k]
        rows.append((coordinate.name, float(truth.ideal[k]), *summed(np.abs(off), inside, width)))
    return rows


def limbs_row(found: KeypointScene, detected: Detected) -> tuple[int, ...]:
    """How many pairs of limbs were exchanged, how many of these were found, how many others, and of how many."""
    swaps = detected.swaps[found.scene.frames]
    detected_swaps = np.zeros_like(swaps) if found.associated is None else found.associated.swaps > 0.5
    return int(swaps.sum()), int((detected_swaps & swaps).sum()), int((detected_swaps & ~swaps).sum()), swaps.size


def run(folder: Path, name: str, cameras: int, case: str, filter: str, seed: int) -> tuple[list[Any], tuple[Any, ...]]:
    """Rows of places and angles, and of limbs, of one recording."""
    subject = recorded(folder, name, seed)
    records = [rig_records(folder)[c] for c in RIG[cameras]]
    detected = detect(subject, records, np.random.default_rng([seed, cameras]), **CASES[case])
    found = scene_of_keypoints(KeypointSettings(detected.people, records, rate=subject.rate, keep=("clocks",)))
    filtered = track(found.scene, TrackSettings(filter=filter)).result
    tree = smooth(filtered, SmoothSettings("laplace", errors="lasting"))
    truth = truth_of(subject, detected, found.scene.frames)
    names = list(subject.body.tree.marker_names)
    index = [names.index(marker) for marker in markers_of_names(LAYOUTS[LAYOUT]) if marker in names]
    near, places = place_row([place_estimates(tree, level)[1] for level in LEVELS], truth.places, index)
    coordinates = opensim_coordinates(subject.body)
    angles = angle_rows(coordinates, [angle_estimates(tree, level)[1] for level in LEVELS], truth)
    key = (name, cameras, case)
    return [(*key, *row) for row in ((PLACES, SHIFT, *places), *angles)], (*key, near, *limbs_row(found, detected))


def main() -> None:
    """Run what is not yet in OUTPUT/simulated_keypoints.csv and OUTPUT/simulated_limbs.csv."""
    options = arguments(
        __doc__, cameras="4,2", cases=",".join(CASES), recordings="", filter="assumed-density", output="simulated-keypoints"
    )
    start_jax()
    folder, output = DATA, options.output
    names = ("simulated_keypoints", "simulated_limbs")
    results, limbs = (
        Table(name, columns, read_runs(output / f"{name}.csv")) for name, columns in zip(names, (COLUMNS, LIMBS), strict=True)
    )
    recordings = options.recordings.split(",") if options.recordings else [*WALKS, OPENSIM]
    cases = itertools.product(options.cases.split(","), options.cameras.split(","), recordings)
    for case, cameras, name in list(cases)[: 1 if options.quick else None]:
        if (name, cameras, case) in {row[:3] for row in limbs.rows}:
            continue
        seed = [*WALKS, OPENSIM].index(name)
        rows, limb = run(folder, name, int(cameras), case, options.filter, seed)
        results.rows.extend(tuple(map(shown, row)) for row in rows)
        limbs.rows.append(tuple(map(shown, limb)))
        for table in (results, limbs):
            write_csv(table, output)
        print(*limbs.rows[-1], *results.rows[-len(rows)][5:], f"{time.process_time():.0f} s", flush=True)


if __name__ == "__main__":
    main()
