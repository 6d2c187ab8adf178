"""The command `poseppl batch keypoints`: every trial of a folder, with one table and one page of all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from poseppl.cli.batch import absolute_model
from poseppl.cli.checks import InputFile, check_inputs
from poseppl.cli.options import common_options, made, max_draws_option, option_group, options_of, seed_option, worker_options
from poseppl.errors import InputError
from poseppl.motion.keypoints.settings import KeypointSettings

EXAMPLES = """
\b
Examples:
  poseppl batch keypoints study/ --rate 60 --dry-run
      What would be tracked: study/subject01/walk1/cam1.json, cam2.json, ..., and study/Calib.toml or one a folder.
  poseppl batch keypoints study/ --rate 60 -o results/
  poseppl batch keypoints study/ --rate 60 --people 2 -o results/
      Two people in each trial, a row each.

\b
Files written, into --output:
  TRIAL/NAME.nc, .png           the smoothed result and its picture; NAME is that of the trial's folder, or
                                NAME-person2 of the second person
  TRIAL/NAME.trc, .mot, .osim   for OpenSim, as poseppl export writes them
  table.csv                     one row a trial and person: frames, residuals, verdict, gait of those who walk, notes
  page.html                     the same to read
  jobs/                         what is done; the same command again goes on from there

\b
Exit status: 0 done, 1 bad input or trials that failed (the others are done), 2 wrong usage, 130 Ctrl-C.
"""

_OF_ALL = ("rate", "unit", "up", "camera", "detector", "layout", "model", "noise", "keep", "frames")


@click.command(epilog=EXAMPLES, short_help="Track people in every trial of a folder.")
@click.argument("folder", type=click.Path())
@click.option(
    "--calibration",
    metavar="FILE",
    type=InputFile(folders=True),
    help="The cameras of all trials. [default: the nearest file called calib in a trial's folder or around it]",
)
@option_group(*options_of(KeypointSettings, *_OF_ALL))
@click.option(
    "--people",
    metavar="N",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="People to track in each trial, at most, those first who are seen best. More who are seen are reported.",
)
@seed_option("Of the draws.")
@max_draws_option
@click.option("--dry-run", is_flag=True, help="Print what was found, and track nothing.")
@click.option("--output", "-o", metavar="DIR", default="batch", show_default=True, help="Folder of all outputs.")
@worker_options
@common_options
def keypoints(folder: str, calibration: str | None, people: int, dry_run: bool, output: str, **options: Any) -> None:
    """Track people in the keypoints of every trial in FOLDER, each as poseppl track keypoints does.

    A trial is a folder with keypoints of two cameras or more, files or folders named as these are in the calibration: cam1.json
    or cam01_json/ of cam_1. The command first prints the trials. A trial that cannot be used costs no other.
    """
    from poseppl.cli.checks import check_new_folder
    from poseppl.cli.console import start_jax

    check_inputs()
    target = Path(output)
    check_new_folder(target, "--output")
    shared = made(KeypointSettings, {**options, "files": {}, "calibration": calibration or ""})

    from poseppl.motion.keypoints.trials import find_trials

    found = find_trials(folder, calibration)
    if dry_run or not options["quiet"]:
        _show(folder, found)
    if dry_run:
        return

    from poseppl.cli.batch_jobs import run_batch
    from poseppl.cli.trial_jobs import TrialJob, digest_of_trial, run_trial, write_trials

    target.mkdir(parents=True, exist_ok=True)
    settings = tuple(sorted((name, _lasting(name, getattr(shared, name))) for name in _OF_ALL if getattr(shared, name)))
    jobs = [
        TrialJob(
            trial=trial.name,
            files=tuple((camera, str(path.resolve())) for camera, path in trial.files.items()),
            calibration=str(trial.calibration.resolve()),
            digest=digest_of_trial(trial, shared),
            folder=str(target.resolve()),
            settings=settings,
            people=people,
            seed=options["seed"],
            max_draws=options["max_draws"],
        )
        for trial in found.trials
        if not trial.problem
    ]
    start_jax()
    records = {record["input"]: record for record in run_batch(run_trial, jobs, target, options, "tracking")}
    lost = {trial.name: {"input": trial.name, "error": trial.problem} for trial in found.trials if trial.problem}
    failed = write_trials([(lost | records)[trial.name] for trial in found.trials], found.passed_over, target)
    if not options["quiet"]:
        click.echo(f"{target}/page.html")
    if failed:
        about = f"{len(failed)} of {len(found.trials)} trials failed"
        raise InputError(f"{about}: {failed[0]}", file=target / "page.html")


def _lasting(name: str, value: Any) -> Any:
    """A setting with absolute paths."""
    if name == "model":
        return absolute_model(value)
    return str(Path(value).resolve()) if name == "noise" and isinstance(value, str) else value


def _show(folder: str, found: Any) -> None:
    """Print the trials."""
    from poseppl.cli.console import print_table

    rows = []
    for trial in found.trials:
        missing = f", without {', '.join(trial.absent)}" if trial.absent else ""
        rows.append(
            (trial.name, trial.problem or f"{len(trial.files)} cameras{missing}", os.path.relpath(trial.calibration, folder))
        )
    print_table(f"Trials in {folder}", rows, ("trial", "cameras", "calibration"))
    for where, why in found.passed_over:
        click.echo(f"passed over: {where}: {why}", err=True)
