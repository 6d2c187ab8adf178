"""Do verdicts notice wrong runs, and accept good ones? Correct runs, and runs with one fault each.

    POSEPPL_DATA=FOLDER python -m studies.faulty_runs [--quick] [--only WORD] [--kept FOLDER]

Each row is a run: mean joint error, mm; coverage of 90 % intervals; and the worst verdict that needs no truth. Simulated
cameras see walks and recordings with noise of 0.003. "Keypoints" are a detector's on pose2sim_balancing, with errors against
the published triangulation; "masks" are drawn of the walk. --kept FOLDER stores results there, and judges stored ones again
without tracking.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr
from poseppl_models.bodies.choo_fleet import full_body
from scipy.spatial.transform import Rotation

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.diagnostics import diagnose, verdicts
from poseppl.motion.recordings.subjects import recorded_subject, walking_subject
from poseppl.motion.tracking import TrackSettings, measure_run, observe_motion, track
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import Scene, noise_of
from poseppl.runs.results import load_result, save_result
from studies.faulty_keypoints import keypoint_scene, triangulated
from studies.faulty_masks import masked_walk

NOISE = 0.003
KALMAN = TrackSettings(filter="kalman")


class Case(NamedTuple):
    """A run: whether it is right, its scene, its settings, and true markers (T, K, 3) that the scene does not know."""

    right: bool
    scene: Callable[[], Any]
    settings: TrackSettings = TrackSettings(filter="assumed-density")
    markers: Callable[[], Any] | None = None


def main() -> None:
    options = arguments(__doc__, only="", kept="")
    start_jax()
    count = 8 if options.quick else 60
    rows = []
    for name, case in cases(DATA, count).items():
        if options.only in name:
            rows.append([name, *judged(case, Path(options.kept) / f"{name}.nc" if options.kept else None)])
            print("|", " | ".join(rows[-1]), "|", flush=True)
            jax.clear_caches()
    show("Worst verdicts without the truth", ["run", "right", "error, mm", "coverage", "worst verdict"], rows)


def judged(case: Case, path: Path | None) -> list[str]:
    """Whether a run is right, its error, its coverage, and its worst verdict."""
    if path is not None and path.is_file():
        tree = load_result(path)
    else:
        tree = track(case.scene(), case.settings).result
        if path is not None:
            save_result(tree, path)
    numbers = measure_run(diagnose(tree))
    error = numbers.joint_error
    if case.markers is not None:
        away = tree["summary/markers_mean"].values - case.markers()
        error = float(np.nanmean(np.linalg.norm(away, axis=-1)))
    coverage = "" if numbers.coverage_state is None else f"{100 * numbers.coverage_state:.0f} %"
    worst = verdicts(without_truth(tree))[0]
    return [
        "yes" if case.right else "no",
        f"{error:.0f}",
        coverage,
        f"{worst.severity}: {worst.text.partition(': ')[0].partition('. ')[0]}",
    ]


def without_truth(tree: xr.DataTree) -> xr.DataTree:
    """A result as it would be if the truth were not known."""
    kept = xr.DataTree.from_dict({name: tree[name].dataset for name in tree.children if name not in ("truth", "diagnostics")})
    kept.attrs = tree.attrs
    return diagnose(kept)


def cases(data: Path, count: int) -> Mapping[str, Case]:
    """All runs by name."""
    cmu = partial(recorded, data / "cmu_amc" / "02_01.amc", data / "cmu_amc" / "02.asf", count)
    run = partial(recorded, data / "cmu_amc" / "02_03.amc", data / "cmu_amc" / "02.asf", count)
    jump = partial(recorded, data / "cmu_amc" / "02_04.amc", data / "cmu_amc" / "02.asf", count)
    dance = partial(recorded, data / "deepmimic" / "humanoid3d_dance_a.txt", data / "deepmimic" / "humanoid3d.txt", count)
    few = min(count, 16)  # frames of masks, which take seconds each
    points, reference = partial(keypoint_scene, data, count), partial(triangulated, data, count)
    return {
        "walk, 1 camera": Case(True, partial(walk, count, cameras=1)),
        "walk, 2 cameras": Case(True, partial(walk, count)),
        "walk, 2 cameras, other noise": Case(True, partial(walk, count, seed=1)),
        "walk, 4 cameras": Case(True, partial(walk, count, cameras=4)),
        "CMU walk, 30 Hz": Case(True, partial(cmu, every=4)),
        "CMU walk, 120 Hz": Case(True, partial(cmu, every=1)),
        "CMU run, 60 Hz": Case(True, partial(run, every=2)),
        "CMU jump, 60 Hz": Case(True, partial(jump, every=2)),
        "the noise is three times the stated one": Case(False, partial(walk, count, noise=3 * NOISE)),
        "the noise is a third of the stated one": Case(False, partial(walk, count, noise=NOISE / 3)),
        "one of two cameras turned by 2 degrees": Case(False, partial(turned, count, 2.0)),
        "one of two cameras turned by 0.5 degrees": Case(False, partial(turned, count, 0.5)),
        "one of four cameras turned by 2 degrees": Case(False, partial(turned, count, 2.0, cameras=4)),
        "lengths 10 % too long": Case(False, partial(longer, count, 1.1)),
        "lengths 10 % too long, 1 camera": Case(False, partial(longer, count, 1.1, cameras=1)),
        "left and right swapped in a camera": Case(False, partial(swapped, count)),
        "left and right swapped in all": Case(False, partial(swapped, count, every=True)),
        "every sixth frame as if each": Case(False, partial(walk, count, every=6)),
        "CMU run of 60 Hz, stated as 480 Hz": Case(False, partial(run, every=2, rate=480.0)),
        "CMU walk of 120 Hz, stated as 5 Hz": Case(False, partial(cmu, every=1, rate=5.0)),
        "the walk of another person in a camera": Case(False, partial(another, count)),
        "HMC filter, 1 camera": Case(False, partial(cmu, every=4, cameras=1), TrackSettings(filter="hmc")),
        "particle filter, 1 camera": Case(False, partial(cmu, every=4, cameras=1), TrackSettings(filter="particle")),
        "dance, 1 camera": Case(False, partial(dance, every=1, cameras=1)),
        "keypoints, noise 0.003": Case(False, partial(points, NOISE), markers=reference),
        "keypoints, noise 0.008": Case(True, partial(points, 0.008), markers=reference),
        "keypoints, another person in two cameras": Case(False, partial(points, 0.008, other=(2, 3)), markers=reference),
        "masks of the walk": Case(True, partial(masked_walk, few)),
        "masks of the walk, extended Kalman filter": Case(False, partial(masked_walk, count), KALMAN),
        "masks of two people": Case(False, partial(masked_walk, few, other=1000.0)),
        "masks that change to another person": Case(False, partial(masked_walk, few, other=1000.0, since=few // 2)),
    }


def walk(
    count: int, *, cameras: int = 2, seed: int = 0, noise: float = NOISE, every: int = 1, rate: float | None = None
) -> Scene[PointData]:
    """The built-in walk, whose noise is claimed to be 0.003."""
    return seen(walking_subject(frames=f"0:{every * count}:{every}"), cameras, seed, noise, rate or 30.0)


def recorded(
    path: Path, skeleton: Path, count: int, *, every: int, cameras: int = 2, rate: float | None = None
) -> Scene[PointData]:
    """A recording."""
    return seen(recorded_subject(path, skeleton, frames=f"0:{every * count}:{every}"), cameras, 0, NOISE, rate)


def seen(subject: Any, cameras: int, seed: int, noise: float, rate: float | None) -> Scene[PointData]:
    """A subject in so many cameras, with noise, of which 0.003 is claimed."""
    scene = observe_motion(subject, cameras_around(subject, count=cameras), camera_names(cameras), noise=noise, seed=seed)
    claimed = noise_of(scene.body, scene.cameras, NOISE)
    return scene._replace(data=PointData(scene.data.points, claimed), rate=scene.rate if rate is None else rate)


def turned(count: int, degrees: float, *, cameras: int = 2) -> Scene[PointData]:
    """The calibration has the second camera turned about the vertical."""
    scene = walk(count, cameras=cameras)
    rotations = np.array(scene.cameras.rotation)
    rotations[1] = rotations[1] @ Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return scene._replace(cameras=scene.cameras._replace(rotation=jax.numpy.asarray(rotations)))


def longer(count: int, factor: float, *, cameras: int = 2) -> Scene[PointData]:
    """The body is claimed to be larger than it is."""
    scene = walk(count, cameras=cameras)
    return scene._replace(body=full_body({name: factor * value for name, value in scene.body.lengths.items()}))


def swapped(count: int, *, every: bool = False) -> Scene[PointData]:
    """Left and right are confused, in the second camera or in all."""
    scene = walk(count)
    names = scene.body.tree.marker_names
    sides = {"_l": "_r", "_r": "_l"}
    other = [names.index(name[:-2] + sides.get(name[-2:], name[-2:])) for name in names]
    points = scene.data.points.copy()
    chosen = slice(None) if every else slice(1, 2)
    points[:, chosen] = points[:, chosen][:, :, other]
    return scene._replace(data=PointData(points, scene.data.noise))


def another(count: int) -> Scene[PointData]:
    """From the middle on, the second camera follows somebody who walks half a metre aside."""
    scene, subject = walk(count), walking_subject(frames=f"0:{count}")
    beside = subject._replace(markers=subject.markers + np.array([500.0, 500.0, 0.0]))
    other = observe_motion(beside, scene.cameras, scene.camera_names, noise=NOISE, seed=1)
    points = scene.data.points.copy()
    points[count // 2 :, 1] = other.data.points[count // 2 :, 1]
    return scene._replace(data=PointData(points, scene.data.noise))


if __name__ == "__main__":
    main()
