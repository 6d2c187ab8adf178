"""The command `poseppl reproduce`."""

from __future__ import annotations

from typing import Any

import click
from poseppl_papers.catalogue import EXPERIMENTS, find_experiment, parts_of

from poseppl.cli.checks import InputFile, check_inputs, files_of_recording
from poseppl.cli.options import common_options, worker_options
from poseppl.errors import InputError, brief

EXAMPLES = """
\b
Examples:
  poseppl reproduce
      The papers, and the parts of their experiments.
  poseppl reproduce choo-fleet-2001 --quick
      All parts on the built-in walk, small: some minutes (needs pip install 'poseppl[experiments]').
  poseppl reproduce choo-fleet-2001 single-frame --motion walk=02_01.amc,02.asf \\
      --motion dance=humanoid3d_dance_a.txt,humanoid3d.txt
      Table 1, Figs. 2 and 3 and the volumes, on recordings, in full.
  poseppl reproduce peursum-2010 trackers --motion walk=02_01.amc,02.asf
      Filters on a walk, rendered in a room with four cameras (needs pip install 'poseppl[render]').
  poseppl reproduce choo-fleet-2001 --scheduler tcp://host:8786
      On a Dask cluster.

\b
Files written to the folder: page.md, which says of each published claim whether it holds; tables
as CSV and tables.nc; tables.json, how each was made; figures as PNG; jobs/, from which the same
command goes on where it was stopped, unless the code has changed since. Tables of parts that are
not run stay, on the page too.
Scenes that trackers see are rendered once, into the cache folder (~/.cache/poseppl/scenes).
Exit status: 0 done, 1 bad input or jobs that failed, 2 wrong usage, 130 Ctrl-C.
"""


def _split(word: str) -> tuple[str, str]:
    """Name and files of a recording.

    Raises:
        InputError: One of them is missing.
    """
    name, _, files = word.partition("=")
    if not (name and files.partition(",")[0]):
        raise InputError(brief(word), field="--motion", expected="NAME=FILE or NAME=FILE,SKELETON")
    return name, files


@click.command(epilog=EXAMPLES, short_help="Run a paper's experiments again.")
@click.argument("paper", required=False, type=click.Choice(list(EXPERIMENTS)))
@click.argument("parts", nargs=-1)
@click.option("--quick", is_flag=True, help="Fewer runs, settings, frames and particles: minutes instead of hours.")
@click.option("--folder", "-o", metavar="DIR", type=click.Path(), help="Folder of all outputs. [default: the paper's name]")
@click.option(
    "--motion",
    "motions",
    metavar="NAME=FILE[,SKELETON]",
    type=InputFile(folders=True, paths=lambda word: files_of_recording(_split(word)[1])),
    multiple=True,
    help="Recording for the experiments: .amc, .bvh, .c3d or DeepMimic's .txt, with its skeleton if it needs one; may be given "
    "several times. Sequences and tuning take the first. [default: the built-in walk]",
)
@worker_options
@common_options
def reproduce(paper: str | None, parts: tuple[str, ...], **options: Any) -> None:
    """Run the experiments of a paper again and say which of its claims hold.

    PARTS are some of the paper's parts; all of them by default. Interrupted runs go on where they were. Without PAPER, all
    papers and their parts are listed.
    """
    from poseppl_papers.recordings import BUILT_IN

    from poseppl.cli.checks import check_new_folder
    from poseppl.cli.console import ConsoleProgress, start_jax

    if paper is None:
        _list_papers()
        return
    known, folder = parts_of(paper), options["folder"] or paper
    for part in parts:
        if part not in known:
            raise click.BadParameter(f"{paper} has no part {brief(part)}; its parts are {', '.join(known)}")
    check_inputs()
    check_new_folder(folder, "--folder")
    recordings = [_recording(word) for word in options["motions"]] or [BUILT_IN]
    if not options["quiet"]:
        click.echo(f"poseppl: {paper}: {', '.join(parts or known)}; results go to {folder}", err=True)

    from poseppl_papers.reproduction import reproduce

    from poseppl.jobs import Processes

    start_jax()
    experiment = find_experiment(paper)
    with ConsoleProgress(options["quiet"], doing="computing", unit="jobs").running() as progress:
        reproduce(
            experiment,
            folder,
            parts=parts,
            recordings=recordings,
            scale=experiment.quick if options["quick"] else None,
            executor=options["scheduler"] or Processes(options["workers"], prepare=start_jax),
            progress=progress,
        )
    if not options["quiet"]:
        click.echo(f"{folder}/page.md")


def _list_papers() -> None:
    from poseppl.cli.console import print_table

    for name in EXPERIMENTS:
        print_table(name, list(parts_of(name).items()))


def _recording(word: str) -> Any:
    from poseppl_papers.recordings import Recording

    name, files = _split(word)
    path, _, skeleton = files.partition(",")
    return Recording.of_file(name, path, skeleton or None)
