"""The command `poseppl fit-motion`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from poseppl.cli.checks import BUILDER, RATE, InputFile, check_inputs, files_of_recording
from poseppl.cli.options import common_options, seed_option
from poseppl.errors import InputError

BODY = "poseppl_models.darby.marker_body:full_body"

EXAMPLES = """
\b
Examples:
  poseppl fit-motion walk 07_01.amc 07_02.amc 16_15.amc 08_01.amc --rate 60
      A walk, from four recordings of three people; their skeletons 07.asf, 16.asf and 08.asf lie beside them.
  poseppl fit-motion run running.amc,somebody.asf jog.bvh --states 20 --plot run.png
      A skeleton that is called otherwise stands after a comma.
  poseppl fit-motion walk 07_01.amc 16_15.amc 08_01.amc --model poseppl_models.bodies.choo_fleet:full_body
      For people in videos, whose body has these coordinates.
  poseppl fit-motion walk 16_15.amc --kind factored --rate 30
      One recorded walk as tables of phases and bins, for a video of 30 frames a second.

\b
Files written:
  NAME.nc   the model, with what it was trained on
  the picture of --plot: the recordings and the states in the first three components
Exit status: 0 done, 1 bad input, 2 wrong usage, 130 Ctrl-C.
"""


@click.command("fit-motion", epilog=EXAMPLES, short_help="Learn an activity from recordings of it.")
@click.argument("name")
@click.argument("files", nargs=-1, required=True, metavar="FILE[,SKELETON]...", type=InputFile(paths=files_of_recording))
@click.option(
    "--model",
    metavar="NAME",
    type=BUILDER,
    default=BODY,
    show_default=True,
    help="The body: package.module:builder or FILE.py:builder.",
)
@click.option(
    "--rate",
    metavar="HZ",
    type=RATE,
    help="Frames a second of the model; every n-th frame of a recording is used. [default: the highest that all can have]",
)
@click.option(
    "--kind",
    type=click.Choice(["components", "factored"]),
    default="components",
    show_default=True,
    help="What is learned: principal components with a hidden Markov model of them (Darby 2008), or of one straight walk the "
    "phases and, for each rotation, tables of 3-degree bins (Peursum 2010).",
)
@click.option("--components", metavar="N", type=click.IntRange(1), default=4, show_default=True, help="Principal components.")
@click.option(
    "--states", metavar="N", type=click.IntRange(1), default=30, show_default=True, help="States of the Markov model."
)
@click.option(
    "--rounds", metavar="N", type=click.IntRange(1), default=50, show_default=True, help="Rounds of Baum-Welch, at most."
)
@click.option("--free", metavar="JOINT", multiple=True, help="Joints that are not learned. [default: the root, neck and head]")
@click.option("--phases", metavar="N", type=click.IntRange(2), default=8, show_default=True, help="Phases of --kind factored.")
@seed_option("Seed of the first parameters of training.")
@click.option("--plot", metavar="FILE.png", type=click.Path(), help="Picture of the states.")
@common_options
def fit_motion(name: str, files: tuple[str, ...], **options: Any) -> None:
    """Learn an activity: principal components of joint angles, and a hidden Markov model of them.

    Each FILE is a recording of the activity as poseppl track takes it. Recordings with one skeleton are of one person, whose
    mean pose is subtracted; a recording without a skeleton is of a person of its own. --kind factored takes one FILE, of a
    person who walks straight on for at least two periods.
    """
    from poseppl.cli.checks import check_writable
    from poseppl.cli.console import ConsoleProgress, print_table, start_jax

    check_inputs()
    _check_kind(files, options["kind"])
    target = Path(name if name.endswith(".nc") else f"{name}.nc")
    picture = None if options["plot"] is None else Path(options["plot"])
    check_writable([target, *([picture] if picture else [])], [part for word in files for part in word.split(",")])
    if picture and options["components"] < 2:
        raise InputError("a single component makes no picture", field="--plot", expected="--components of 2 or more")

    from poseppl.motion.learned import (
        TrainingSettings,
        learn_factored_motion,
        train_motion_model,
        write_factored_motion,
        write_motion_model,
    )

    settings = TrainingSettings(
        options["components"], options["states"], options["rounds"], options["seed"], options["free"] or None
    )
    progress = ConsoleProgress(options["quiet"], doing="fitting the body")
    start_jax()
    with progress.running():
        recordings = _pose(files, options["model"], options["rate"], progress)
    if options["kind"] == "factored":
        walk = learn_factored_motion(recordings[0], options["model"], num_phases=options["phases"])
        write_factored_motion(walk, target)
        if not options["quiet"]:
            print_table("poseppl fit-motion", [*_summary_of_walk(walk), ("model", str(target))])
        return
    training = ConsoleProgress(options["quiet"], doing="training", unit="rounds at most")
    with training.running():
        training.stage("training", settings.num_rounds)
        model = train_motion_model(recordings, options["model"], settings, advance=training.advance)
    write_motion_model(model, target)
    if picture is not None:
        _draw(model, recordings, picture)
    if not options["quiet"]:
        print_table(
            "poseppl fit-motion", [*_summary(model), ("model", str(target)), *([("plot", str(picture))] if picture else [])]
        )


def _check_kind(files: tuple[str, ...], kind: str) -> None:
    """Refuse what a kind of motion does not take.

    Raises:
        click.UsageError: Options of the other kind.
        InputError: Several recordings of a single walk.
    """
    other = {"factored": ("components", "states", "rounds", "free", "plot", "seed"), "components": ("phases",)}[kind]
    context = click.get_current_context()
    given = [name for name in other if context.get_parameter_source(name) == ParameterSource.COMMANDLINE]
    if given:
        raise click.UsageError(f"--{given[0]} does not go with --kind {kind}")
    if kind == "factored" and len(files) > 1:
        raise InputError(f"{len(files)} recordings", field="FILE", expected="one walk for --kind factored")


def _summary_of_walk(walk: Any) -> list[tuple[str, str]]:
    speed = float(walk.tables.first_phase @ walk.tables.velocities[:, 0])
    return [
        ("frames", f"{walk.provenance['frames']} at {walk.rate:g} Hz"),
        ("fit of the body", f"{walk.provenance['residual mm']:.1f} mm"),
        ("phases", str(len(walk.tables.first_phase))),
        ("speed", f"{speed / 1000:.2f} m/s"),
    ]


def _pose(files: tuple[str, ...], model: str, rate: float | None, progress: Any) -> list[Any]:
    """The recordings as poses, at one rate."""
    from poseppl.motion.learned import common_rate, pose_recording, read_recording

    progress.stage("reading")
    recordings = []
    for word in files:
        path, _, skeleton = word.partition(",")
        recordings.append(read_recording(path, skeleton or None))
    rates = [recording.motion.rate for recording in recordings]
    chosen = common_rate(rates) if rate is None else rate
    if len({round(each, 3) for each in rates}) > 1:
        progress.note(f"recordings of {min(rates):g} to {max(rates):g} frames a second: {chosen:g} of each are taken")
    counts = [round(len(recording.motion.positions) * chosen / recording.motion.rate) for recording in recordings]
    progress.stage("fitting the body", sum(counts))
    posed = []
    for recording, count in zip(recordings, counts, strict=True):
        posed.append(pose_recording(recording, model, chosen))
        progress.advance(count)
    return posed


def _draw(model: Any, recordings: list[Any], path: Path) -> None:
    from poseppl.motion.learned.states_picture import plot_states
    from poseppl.report.picture import save_picture

    features = [(recording.person, model.features(recording.states, recording.person)) for recording in recordings]
    save_picture(plot_states(model, features), path)


def _summary(model: Any) -> list[tuple[str, str]]:
    residual = max(model.provenance["residuals mm"])
    return [
        ("frames", f"{sum(model.provenance['frames'])} at {model.rate:g} Hz"),
        ("persons", ", ".join(model.persons)),
        ("fit of the body", f"{residual:.1f} mm at worst"),
        ("variance kept", f"{100 * model.explained:.1f} % by {model.components.shape[1]} components"),
        ("states", str(len(model.means))),
        ("log-likelihood", f"{model.log_likelihoods[-1]:.1f} after {len(model.log_likelihoods)} rounds"),
    ]
