"""The command `poseppl batch`: every table of a folder, or every trial that cameras recorded; tables where nothing is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.options import chosen, common_options, worker_options
from poseppl.cli.run import check_model, model_options
from poseppl.cli.settings import CommandWithSettings
from poseppl.errors import InputError

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
