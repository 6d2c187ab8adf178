"""A learned walk as the prior of people it was not learned from, in one camera; and what it does to other motion.

    POSEPPL_DATA=FOLDER python -m studies.learned_prior [--quick] [--recordings ...] [--cases alone,mixture,default]
        [--runs 2] [--scenes FOLDER] [--noise 200] [--output learned-prior]
    poseppl simulate 05_01.amc --skeleton 05.asf --frames 0:320:4 --video --no-clutter -o FOLDER/05_01

Activities are learned from walks of cmu_walks, up to three of each person, without the person who is tracked. The first 80
frames of a recording at 30 Hz are seen by one camera as points with noise of 0.003 focal lengths, 3 px; with --scenes as
silhouettes found in the video of camera_1 of FOLDER/RECORDING, whose empty room is known, with noise in mm. A case is

alone      the learned activity as the prior (`--prior, --set other_motion=false`)
mixture    the same or other motion, as the data tell (`--prior`)
default    the default tracker without a prior

For joints relative to the pelvis the table has the mean distance of posterior means from the truth, mm, and the coverage of
central 50 % and 90 % intervals of the draws. It also has the mean probability of the activity, and frames a second without
compilation. For silhouettes it has the severity of the verdict on their overlap, which needs no truth. Runs in
OUTPUT/learned_prior.csv are not made again.
"""

from __future__ import annotations

import itertools
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.io import VideoWarning
from poseppl.motion.learned import pose_recording, read_recording, train_motion_model, write_motion_model
from poseppl.motion.measures import root_index
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.silhouettes.frame import SilhouetteSettings
from poseppl.motion.silhouettes.video_sources import see_silhouettes, sources_of_scene
from poseppl.motion.tracking import Scene, TrackSettings, observe_motion, track
from poseppl.motion.tracking.learned_prior import SILHOUETTE_NOISE
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.motion.verdicts.agreement import overlap
from studies.kept_runs import keep_run, read_runs

RATE, NOISE, NUM_FRAMES = 30.0, 0.003, 80
POINTS, SILHOUETTES = "poseppl_models.darby.marker_body:full_body", "poseppl_models.bodies.silhouettes:full_body"
"""Bodies that are seen as one and the other."""
RECORDINGS = (
    "05_01,06_01,07_03,07_08,08_03,08_06,16_47,16_58,35_12,35_33,02_01,02_03,02_04,02_05"  # the last three are no walks
)
LEARNED_FROM = {
    "05": ("05_01",),
    "06": ("06_01",),
    "07": ("07_01", "07_02", "07_06"),
    "08": ("08_01", "08_02", "08_04"),
    "16": ("16_15", "16_16", "16_31"),
    "35": ("35_01", "35_05", "35_10"),
}
CASES: dict[str, dict[str, Any]] = {
    "alone": {"filter": "switching", "other_motion": False},
    "mixture": {"filter": "switching"},
    "default": {"filter": "assumed-density"},
}
_COLUMNS = ("recording", "case", "seed", "error", "coverage_50", "coverage_90", "probability", "frames_per_second")


def learn(data: Path, output: Path, person: str, body: str) -> Path:
    """The file of the activity of all persons but one, learned if it is not there."""
    path = output / f"without_{person}_{body.split('.')[-1].partition(':')[0]}.nc"
    if not path.exists():
        names = [name for other, own in LEARNED_FROM.items() if other != person for name in own]
        recordings = [pose_recording(read_recording(data / "cmu_walks" / f"{name}.amc"), body, RATE) for name in names]
        write_motion_model(train_motion_model(recordings, body), path)
    return path


def watch(data: Path, name: str, num_frames: int, seed: int) -> Scene[Any]:
    """The first frames of a recording of 120 Hz in one camera."""
    folder = next(each for each in (data / "cmu_walks", data / "cmu_amc") if (each / f"{name}.amc").exists())
    skeleton = folder / f"{name.partition('_')[0]}.asf"
    subject = recorded_subject(folder / f"{name}.amc", skeleton, model=POINTS, frames=f"::{round(120 / RATE)}")
    scene = observe_motion(subject, cameras_around(subject, count=1), camera_names(1), noise=NOISE, seed=seed)
    return scene.first_frames(num_frames)


def look(folder: Path, num_frames: int, settings: SilhouetteSettings | None) -> Scene[Any]:
    """The silhouettes of a scene's first frames in one camera."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VideoWarning)
        return see_silhouettes(sources_of_scene(folder, ("camera_1",)), settings=settings, stop=num_frames)


def judge(tree: xr.DataTree) -> tuple[float, ...]:
    """Error, coverage of 50 % and 90 % intervals, probability of the activity, frames a second."""
    root = root_index(tree)
    draws = np.asarray(tree["posterior/markers"].values, np.float64)
    draws, truth = draws.reshape(-1, *draws.shape[2:]), np.asarray(tree["truth/markers"].values)
    apart, true = (np.delete(each - each[..., root : root + 1, :], root, -2) for each in (draws, truth))
    error = np.linalg.norm(apart.mean(0) - true, axis=-1).mean()
    bounds = [np.quantile(apart, [(1 - level) / 2, (1 + level) / 2], axis=0) for level in (0.5, 0.9)]
    shares = [np.mean((low <= true) & (true <= high)) for low, high in bounds]
    known = tree["summary"].dataset
    probability = float(known["prior_mean"].mean()) if "prior_mean" in known else np.nan
    return float(error), *map(float, shares), probability, len(true) / float(tree.attrs["wall_seconds"])


def run(data: Path, output: Path, key: tuple[str, str, str], num_frames: int, scenes: str, noise: float) -> tuple[str, ...]:
    """Measurements of a run of a recording, a case and a seed."""
    name, case, seed = key
    body = SILHOUETTES if scenes else POINTS
    prior = None if case == "default" else str(learn(data, output, name.partition("_")[0], body))
    settings = TrackSettings(model=body, prior=prior, seed=int(seed), **CASES[case])
    if scenes:
        seen = look(Path(scenes) / name, num_frames, SilhouetteSettings(noise=noise) if prior else None)
    else:
        seen = watch(data, name, num_frames, int(seed))
    tree = track(seen, settings).result
    worst = [next((verdict.severity for verdict in overlap(tree)), "none")] if scenes else []
    return *(f"{value:.5g}" for value in judge(tree)), *worst


def main() -> None:
    options = arguments(
        __doc__,
        recordings=RECORDINGS,
        cases=",".join(CASES),
        runs=2,
        scenes="",
        noise=SILHOUETTE_NOISE,
        output="learned-prior",
    )
    start_jax()
    data, output = DATA, options.output
    num_frames, runs = (5, 1) if options.quick else (NUM_FRAMES, options.runs)
    found = read_runs(output / "learned_prior.csv")
    columns = (*_COLUMNS, "overlap") if options.scenes else _COLUMNS
    table = Table("learned_prior", columns, found, "Runs of learned_prior.py: errors in mm, shares of the joints' coordinates.")
    done = {row[:3] for row in table.rows}
    for key in itertools.product(options.recordings.split(","), options.cases.split(","), map(str, range(runs))):
        if key not in done:
            keep_run(table, (*key, *run(data, output, key, num_frames, options.scenes, options.noise)), output)
    show("Runs", columns, [[str(value) for value in row] for row in table.rows])


if __name__ == "__main__":
    main()
