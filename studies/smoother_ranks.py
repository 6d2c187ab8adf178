"""Simulation-based calibration of the smoother of a detector's keypoints: is the truth one of its draws like any other?

    POSEPPL_DATA=FOLDER python -m studies.smoother_ranks [--quick] [--cases right,corrected,independent,half] [--cameras 4,2]
        [--replicates 100] [--output smoother-ranks]

Poses, offsets from the joints, autocorrelated errors and keypoints are drawn from ``poseppl_models.bodies.detected_points``, 20
frames at 30 Hz in the laboratory's cameras (studies/laboratory_rig.py). Inputs are those that the tracker makes of a walk: the
learned steps, the noise of the body, a start with the precision of an estimated one. A twentieth of the keypoints is missing,
and those that the detector does not have. The default smoother, Laplace's, gets the same program and inputs. Its 500 draws are
compared with the truth in three frames of each replicate: randomised ranks u in (0, 1), uniform if all is right (Talts et al.
2018, arXiv:1804.06788).

Replicates are independent, ranks within one are not. Uniformity is judged by the ten bins' shares of each replicate: their
mean's distance from 1/10 in Hotelling's T^2 with the covariance between replicates. ECE is the mean distance of coverage from
its level, over 10 to 90 %. Deliberately wrong smoothers, with half of the noise or with independent errors, have to be found.
With "corrected" cameras, poses are off by draws of the refinement's prior and are corrected first, as the tracker does it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.detected_points import DetectedBody, seen_by_detector
from poseppl_papers.tables import Table, write_csv
from scipy.stats import f as fisher

from benchmarks.timing import DATA, arguments
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.diagnostics.calibration import randomised_ranks
from poseppl.motion.bodies.body import BodyInputs, compile_once
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.camera_refinement import PRIOR_ANGLE, PRIOR_POSITION, bundle_adjust
from poseppl.motion.keypoints.drawn_detections import GAP_SHARE, LAYOUT
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking.lasting_errors import with_ar1_noise
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import Problem, make_problem
from poseppl.motion.tracking.scene import Scene, noise_of
from poseppl.motion.tracking.start import start_scales
from poseppl.program import CompiledModel
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.simulation import draw_sequence
from poseppl.smoothers import laplace_smoother, smoothed_moments
from poseppl.smoothers.base import History
from poseppl.smoothers.laplace import cut_laplace_smoother
from studies.laboratory_rig import RIG, rig_middle, rig_records

FRAMES, RATE, BINS = 20, 30.0, 10
JUDGED = (0, FRAMES // 2, FRAMES - 1)
"""Frames whose ranks count."""
LEVELS = np.arange(1, 10) / 10
CASES: Mapping[str, Callable[[Any], Any]] = {
    "right": lambda inputs: inputs,
    "corrected": lambda inputs: inputs,
    "independent": lambda inputs: with_errors(inputs, error_share=1e-6 * jnp.ones_like(inputs.errors.error_share)),
    "half": lambda inputs: inputs._replace(noise=inputs.noise / 2),
}
"""Inputs of the smoother, by name: those of the truth, those with corrected cameras, and wrong ones."""
COLUMNS = ("smoother", "cameras", "of", "replicates", *(f"bin_{k}" for k in range(BINS)))
COLUMNS = (*COLUMNS, "statistic", "chance", "ece", "ece_error", "coverage_50", "coverage_90")


class Study(NamedTuple):
    """Problem from which truths are drawn, and with which they are smoothed.

    Attributes:
        body: The programs.
        truth: The compiled model that draws, with or without errors of the cameras.
        model: The compiled model that is smoothed.
        pose: The problem of poses alone, from which the smoother's start comes.
        inputs: Inputs of the truth, with a leading T.
        seen: (K,) whether the detector has a marker.
    """

    body: DetectedBody
    truth: CompiledModel
    model: CompiledModel
    pose: Problem
    inputs: Any
    seen: Any


def walk_scene(folder: Path, cameras: int) -> Scene[PointData]:
    """The built-in walk in the middle of the rig, as a detector without autocorrelated errors sees it."""
    records = [rig_records(folder)[c] for c in RIG[cameras]]
    subject, seers = walking_subject(frames=f"0:{FRAMES}", rate=RATE), cameras_of_records(records)
    shift = np.append((rig_middle(records) - subject.markers.mean((0, 1)))[:2], 0.0)
    states = subject.states + np.append(shift, np.zeros(subject.states.shape[1] - 3))
    clean = np.moveaxis(np.asarray(project(seers, jnp.asarray(subject.markers + shift, float))), 0, 1)
    noise = noise_of(subject.body, seers, None)
    points = clean + noise[..., None] * np.random.default_rng(0).standard_normal(clean.shape)
    names = tuple(record.name for record in records)
    return Scene(subject.body, seers, names, PointData(points, noise), np.arange(FRAMES), RATE, "", states)


def study(folder: Path, cameras: int, corrected: bool) -> Study:
    """The programs with inputs that the tracker makes of a walk."""
    scene = walk_scene(folder, cameras)
    pose = make_problem(scene)
    lasting = with_ar1_noise(pose, scene.frames, scene.rate)
    inputs = frame_sequence(lasting.observations, lasting.inputs, None).stacked_inputs()
    inputs = inputs._replace(start_scale=jnp.broadcast_to(jnp.asarray(start_scales(scene.body), float), inputs.start.shape))
    tree = scene.body.tree
    body = seen_by_detector(tree.coordinates, len(tree.marker_names), cameras, corrected)
    if corrected:
        root = np.diag(np.tile(np.repeat([PRIOR_ANGLE, PRIOR_POSITION], 3), cameras))
        inputs = with_errors(inputs, camera_root=jnp.broadcast_to(jnp.asarray(root, float), (FRAMES, *root.shape)))
    model = compile_once(body.program, jax.tree.map(lambda leaf: leaf[0], inputs))
    seen = np.array([name in markers_of_names(LAYOUTS[LAYOUT]) for name in tree.marker_names])
    return Study(body, model, model, pose, inputs, seen)


def with_errors(inputs: BodyInputs, **errors: Any) -> BodyInputs:
    """Inputs with other autocorrelated errors."""
    return inputs._replace(errors=inputs.errors._replace(**errors))


def corrected_inputs(inputs: Any, points: Floats) -> Any:
    """Inputs with the cameras refined by the points, and what remains unknown of them."""
    cameras: Cameras = jax.tree.map(lambda leaf: leaf[0], inputs.cameras)
    noise = float(np.asarray(inputs.noise).mean())
    refined = bundle_adjust(cameras, points, np.ones(points.shape[:3]), noise, RATE)
    root = np.linalg.cholesky(refined.covariance)
    given: Any = (refined.cameras, jnp.asarray(root, float))
    seers, root = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (FRAMES, *leaf.shape)), given)
    return with_errors(inputs._replace(cameras=seers), camera_root=root)


@partial(jax.jit, static_argnums=(0, 1))
def _draws(body: DetectedBody, model: CompiledModel, key: Any, start: Any, observations: Any, inputs: Any) -> tuple[Any, Any]:
    """Draws (N, T, d) of poses and (N, T, 3 K) of markers."""
    smoother = cut_laplace_smoother(model, body.num_static) if body.num_static else laplace_smoother(model)
    beside = jnp.zeros((FRAMES, model.dimension - start.shape[1]))
    none = jnp.zeros((FRAMES, 1))
    history = History(jnp.concatenate([start, beside], 1)[:, None], none, none.astype(int), none[:, 0] > 0)
    found = smoother.smooth(key, history, observations, inputs).particles
    return tuple(jnp.swapaxes(each, 0, 1) for each in jax.vmap(jax.vmap(partial(_parts, body), (0, None)))(found, inputs))


def _parts(body: DetectedBody, x: Any, inputs: Any) -> tuple[Any, Any]:
    return body.pose(x, inputs), body.markers(x, inputs).ravel()


@partial(jax.jit, static_argnums=(0, 1))
def _truth(body: DetectedBody, model: CompiledModel, key: Any, inputs: Any) -> tuple[tuple[Any, Any], Any]:
    """Poses and markers of a draw, and its points."""
    states, data = draw_sequence(model, jax.random.split(key, (FRAMES, 2)), inputs)
    return jax.vmap(partial(_parts, body))(states, inputs), data["points"]


@partial(jax.jit, static_argnums=0)
def _start(model: CompiledModel, observations: Any, inputs: Any) -> Any:
    return smoothed_moments(model, observations, inputs).mean


def ranks(found: Study, given: Callable[[Any], Any], seed: int) -> dict[str, Floats]:
    """Ranks (frames, coordinates) of one replicate, of the pose and of the joints that the detector has."""
    rng = np.random.default_rng(seed)
    truth, clean = _truth(found.body, found.truth, jax.random.key(seed), found.inputs)
    hidden = ~found.seen | (rng.random(clean.shape[:3]) < GAP_SHARE)
    points = np.where(hidden[..., None], np.nan, np.asarray(clean, np.float64))
    inputs = given(corrected_inputs(found.inputs, points) if found.body.num_static else found.inputs)
    alone = inputs._replace(errors=None, velocities=None, step_scale=jnp.asarray(found.pose.inputs.step_scale))
    start = _start(found.pose.model, found.pose.model.observe({"points": points}), alone)
    key = jax.random.fold_in(jax.random.key(seed), 1)
    draws = _draws(found.body, found.model, key, start, found.model.observe({"points": points}), inputs)
    judged = {}
    for name, drawn, true in zip(("pose", "joints"), draws, truth, strict=True):
        index = np.flatnonzero(np.repeat(found.seen, 3)) if name == "joints" else np.arange(true.shape[1])
        values, right = (np.asarray(each)[..., list(JUDGED), :][..., index] for each in (drawn, true))
        judged[name] = randomised_ranks(values, right, rng.random(right.shape))
    return judged


def covered(values: Floats, level: float) -> Floats:
    """Share of the ranks (replicates, ...) of each replicate in the middle."""
    inside = np.abs(values - 0.5) < level / 2
    return np.asarray(inside.reshape(len(values), -1).mean(1))


def bin_shares(values: Floats) -> Floats:
    """Shares (replicates, bins) of the ranks of each replicate."""
    index = np.minimum((values.reshape(len(values), -1) * BINS).astype(int), BINS - 1)
    return np.stack([(index == k).mean(1) for k in range(BINS)], 1)


def uniformity(values: Floats) -> tuple[float, float]:
    """Hotelling's T^2 of the bins' shares of replicates against equal ones, and its chance if ranks are uniform."""
    shares = bin_shares(values)[:, 1:] - 1 / BINS
    count, size = shares.shape
    statistic = float(count * shares.mean(0) @ np.linalg.solve(np.cov(shares.T), shares.mean(0)))
    return statistic, float(fisher.sf(statistic * (count - size) / (size * (count - 1)), size, count - size))


def calibration_error(values: Floats) -> float:
    """Mean distance of coverage from its level."""
    return float(np.mean([abs(covered(values, level).mean() - level) for level in LEVELS]))


def judged_row(values: Floats) -> tuple[float, ...]:
    """The numbers of a row: bins, statistic and chance, ECE and its jackknife error, coverage."""
    count = len(values)
    left_out = [calibration_error(np.delete(values, k, 0)) for k in range(count)]
    error = float(np.sqrt((count - 1) / count * np.square(left_out - np.mean(left_out)).sum()))
    held = [float(covered(values, level).mean()) for level in (0.5, 0.9)]
    return (*bin_shares(values).mean(0).tolist(), *uniformity(values), calibration_error(values), error, *held)


def main() -> None:
    """Print and write OUTPUT/smoother_ranks.csv, again after each case."""
    options = arguments(__doc__, cases=",".join(CASES), cameras="4,2", replicates=100, output="smoother-ranks")
    start_jax()
    folder, output = DATA, options.output
    table = Table("smoother_ranks", COLUMNS, [])
    for cameras in map(int, options.cameras.split(",")):
        for case in options.cases.split(","):
            kept = output / f"{case}-{cameras}.npz"
            found = study(folder, cameras, case == "corrected")
            values = {name: list(rows) for name, rows in np.load(kept).items()} if kept.exists() else {"pose": [], "joints": []}
            for seed in range(len(values["pose"]), 12 if options.quick else options.replicates):
                for name, row in ranks(found, CASES[case], seed).items():
                    values[name].append(row)
                np.savez(kept, **{name: np.stack(rows) for name, rows in values.items()})
            for name, rows in values.items():
                table.rows.append((case, str(cameras), name, str(len(rows)), *judged_row(np.stack(rows))))
                print(*table.rows[-1], flush=True)
            write_csv(table, output)


if __name__ == "__main__":
    main()
