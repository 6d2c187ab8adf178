"""Which filter follows a rendered person, with how many cameras, with and without furniture?

    poseppl simulate 02_01.amc --skeleton 02.asf --frames 0:160:4 --video --no-clutter -o clean
    poseppl simulate 02_01.amc --skeleton 02.asf --frames 0:160:4 --video --clutter -o clutter
    python -m studies.rendered_walks [--quick] [--scenes clean,clutter] [--filters ...] [--cameras 4,2,1] [--frames 40]
        [--runs 3] [--true-masks] [--noise 80] [--edges] [--refine]
        [--output rendered-walks]

Silhouettes are found in the videos, whose empty rooms are known, or taken from the renderer (--true-masks). Each run starts
around the truth. At 30 frames a second the person moves 40 mm a frame, and so does the random walk here (its default is 15 mm a
frame at that rate). Errors are mean distances of posterior means of the joints from the truth, mm, and the same relative to the
pelvis. Coverage is that of 90 % intervals of the joints' coordinates. Seconds a frame are without compilation. Runs differ in
their seed; the table has their means and standard deviations. Runs in OUTPUT/runs.csv are reused.
"""

from __future__ import annotations

import itertools
import statistics
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.io import VideoWarning, open_masks
from poseppl.motion.silhouettes.data import SilhouetteData
from poseppl.motion.silhouettes.frame import SilhouetteSettings
from poseppl.motion.silhouettes.video_sources import see_silhouettes, sources_of_scene
from poseppl.motion.tracking import TrackSettings, measure_run, track
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.vision import BackgroundSettings
from poseppl.runs.results import provenance
from studies.kept_runs import read_runs

NAMES = ("camera_1", "camera_2", "camera_3", "camera_4")
"""In the corners of the room; two cameras are neighbours."""
FILTERS = "assumed-density,tempered,hmc,kalman,annealed,demc,particle"
_COLUMNS = ("scene", "cameras", "filter", "seed", "frames", "error", "relative", "coverage", "seconds", "compile")
_KEY = 5
"""So many columns tell which run it was."""


def main() -> None:
    options = arguments(
        __doc__,
        scenes="clean,clutter",
        filters=FILTERS,
        cameras="4,2,1",
        frames=40,
        runs=3,
        true_masks=False,
        noise=80.0,
        edges=False,
        refine=False,
        output="rendered-walks",
    )
    start_jax()
    frames, runs = (3, 1) if options.quick else (options.frames, options.runs)
    table = Table("runs", _COLUMNS, read_runs(options.output / "runs.csv"), "Runs of rendered_walks.py; mm and seconds.")
    settings = SilhouetteSettings(noise=options.noise, edges=options.edges)
    special = (" true masks" if options.true_masks else "") + (f" {options.noise:g} mm" if options.noise != 80 else "")
    special += (" edges" if options.edges else "") + (" refined" if options.refine else "")
    background = BackgroundSettings(refine=options.refine)
    for scene, cameras in itertools.product(options.scenes.split(","), options.cameras.split(",")):
        runs_of = itertools.product(options.filters.split(","), range(runs))
        wanted = [(scene + special, cameras, name, str(seed), str(frames)) for name, seed in runs_of]
        missing = [key for key in wanted if key not in {row[:_KEY] for row in table.rows}]
        seen = see(scene, NAMES[: int(cameras)], frames, options.true_masks, settings, background) if missing else None
        for key in missing:
            table.rows.append((*key, *run_of(seen, key[2], int(key[3]))))
            write_csv(table, options.output)
            jax.clear_caches()  # programs of many runs together are more than a process may map
            print(*table.rows[-1], flush=True)
    columns = ["scene", "cameras", "filter", "error", "relative", "coverage, %", "s a frame"]
    show(f"{frames} frames", columns, summed(table.rows))


def see(
    folder: str, cameras: Sequence[str], frames: int, true_masks: bool, settings: Any, background: Any
) -> Scene[SilhouetteData]:
    """The silhouettes of a rendered scene."""
    sources = sources_of_scene(folder, cameras)
    if true_masks:
        masks = {name: open_masks(Path(folder) / f"{name}_visible.npz", f"{name} (masks)") for name in cameras}
        sources = sources._replace(masks=masks)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VideoWarning)
        return see_silhouettes(sources, settings=settings, background=background, stop=frames)


def run_of(seen: Any, name: str, seed: int) -> tuple[str, ...]:
    """Error, relative error, coverage, seconds a frame, and of compilation."""
    tree = track(seen, TrackSettings(filter=name, seed=seed, sigma_position=40.0 * 30.0**0.5)).result
    numbers, known = measure_run(tree), provenance(tree)
    found = (
        numbers.joint_error,
        numbers.joint_error_relative,
        numbers.coverage,
        1 / (numbers.frames_per_second or float("nan")),
        known["compile_seconds"],
    )
    return tuple(f"{value:.5g}" for value in found)


def summed(rows: list[tuple[str, ...]]) -> list[list[str]]:
    """Mean and standard deviation over seeds."""
    groups: dict[tuple[str, ...], list[tuple[float, ...]]] = {}
    for row in rows:
        groups.setdefault((*row[:3], row[4]), []).append(tuple(map(float, row[_KEY:])))
    shown = []
    for (scene, cameras, name, _), values in groups.items():
        error, relative, coverage, seconds, _ = zip(*values, strict=True)
        spread = f" ± {statistics.stdev(error):.0f}" if len(error) > 1 else ""
        means = (
            f"{statistics.mean(relative):.0f}",
            f"{100 * statistics.mean(coverage):.0f}",
            f"{statistics.median(seconds):.2g}",
        )
        shown.append([scene, cameras, name, f"{statistics.mean(error):.0f}{spread}", *means])
    return shown


if __name__ == "__main__":
    main()
