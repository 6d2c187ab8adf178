"""The commands `poseppl batch` and `poseppl batch keypoints`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs
from poseppl.cli.options import (
    chosen,
    common_options,
    made,
    max_draws_option,
    option_group,
    options_of,
    seed_option,
    worker_options,
)
from poseppl.cli.run import check_model, model_options
from poseppl.cli.settings import CommandWithSettings
from poseppl.errors import InputError
from poseppl.motion.keypoints.settings import KeypointSettings

GROUP_EXAMPLES = """
\b
Examples:
  poseppl batch trials/ --model model.py --filter kalman
  poseppl batch keypoints study/ --rate 60 -o results/

\b
Files written: results, a table and a page of all, into --output; poseppl batch COMMAND --help lists them.

\b
Exit status: 0 done, 1 bad input or something that failed (the rest is done), 2 wrong usage, 130 Ctrl-C.
"""
EXAMPLES = """
\b
Examples:
  poseppl batch trials/ --model model.py --filter kalman
  poseppl batch trials/ --model model.py --settings run.toml --workers 2 -o results/
  poseppl batch trials/ --model model.py --scheduler tcp://host:8786

\b
Files written, into --output:
  NAME.nc, NAME.png  the result of each table, and its picture; with --smooth NAME-METHOD.nc, .png
  table.csv          one row a table: frames, evidence, seconds, the worst verdict
  page.md            the same to read
  jobs/              what is done; the same command again goes on from there

\b
Exit status: 0 done, 1 bad input or tables that failed (the others are done), 2 wrong usage, 130 Ctrl-C.
"""

_KINDS = (".csv", ".parquet", ".pq", ".nc")


class BatchGroup(click.Group):
    """A group whose first word may be left out: a folder of tables is meant."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, as click does."""
        known = (*self.commands, *ctx.help_option_names)
        return super().parse_args(ctx, args if not args or args[0] in known else ["tables", *args])


@click.group(cls=BatchGroup, epilog=GROUP_EXAMPLES, short_help="Every table, or every trial of cameras, in a folder.")
def batch() -> None:
    """Run one computation on all that is in a folder, in several processes, resumed after a kill.

    Without a command's name, the tables of a folder are meant.
    """


@batch.command(cls=CommandWithSettings, epilog=EXAMPLES, short_help="Run your own model on every table of a folder.")
@click.argument("folder", type=click.Path())
@click.option("--model", metavar="MODEL", required=True, help="FILE.py[:NAME] or package.module[:NAME].")
@model_options
@click.option("--output", "-o", metavar="DIR", default="batch", show_default=True, help="Folder of all outputs.")
@worker_options
@common_options
def tables(folder: str, model: str, **options: Any) -> None:
    """Run a filter of the model on every table in FOLDER (.csv, .parquet, .nc), in several processes, resumed after a kill."""
    from poseppl.cli.checks import check_new_folder
    from poseppl.cli.console import start_jax

    check_model(model, options)
    paths, target = _tables(Path(folder)), Path(options["output"])
    check_new_folder(target, "--output")

    from poseppl.cli.batch_jobs import TableJob, digest_of, run_batch, run_table, write_overview
    from poseppl.cli.model_runs import given_params, source_digest
    from poseppl.runs.algorithms import FILTERS

    FILTERS[options["filter_name"]].check(options["settings"])
    target.mkdir(parents=True, exist_ok=True)
    jobs = [
        TableJob(
            table=str(path.resolve()),
            digest=digest_of(path),
            model=absolute_model(model),
            source=source_digest(model),
            folder=str(target.resolve()),
            settings=tuple(sorted(options["settings"].items())),
            inputs=tuple(options["inputs"]),
            params=given_params(options),
            smooth=options["smooth"] or "",
            hindcast=options["hindcast"] or 0,
            **chosen(options, "filter_name", "seed", "max_draws", "history_mib", "fill_gaps"),
        )
        for path in paths
    ]
    start_jax()
    failed = write_overview(run_batch(run_table, jobs, target, options, "filtering"), target)
    if not options["quiet"]:
        click.echo(f"{target}/page.md")
    if failed:
        raise InputError(f"{len(failed)} of {len(jobs)} tables failed: {failed[0]}", file=target / "page.md")


def absolute_model(model: str) -> str:
    """A model whose file is found from any folder."""
    source = Path(model.partition(":")[0])
    return str(source.resolve()) + model[len(str(source)) :] if source.suffix == ".py" else model


def _tables(folder: Path) -> list[Path]:
    """The tables of a folder, by name."""
    if not folder.is_dir():
        raise InputError("no such folder", file=folder, expected="a folder of tables")
    found = sorted(path for path in folder.glob("[!.]*") if path.suffix.lower() in _KINDS and path.is_file())
    stems = [path.stem for path in found]
    twice = sorted({stem for stem in stems if stems.count(stem) > 1})
    if not found or twice:
        problem = f"two tables are called {twice[0]}" if twice else "there is no table in it"
        raise InputError(problem, file=folder, expected="tables of different names, .csv, .parquet or .nc")
    return found


KEYPOINT_EXAMPLES = """
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


@click.command(epilog=KEYPOINT_EXAMPLES, short_help="Track people in every trial of a folder.")
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
