"""Options that several commands share, and arguments that findings and errors name as options.

>>> as_option(Argument("walk", "learned")), as_option(Argument("num_chains", 50, setting=True))
('--walk learned', '--set num_chains=50')
>>> as_option(Argument("sigma_angle")), as_option(Argument("files"))
('--set sigma_angle', 'FILES')
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import Any, Literal, TypeVar, get_args, get_origin

import click

from poseppl.cli.checks import BUILDER, InputFile, file_of_pair, number
from poseppl.errors import Argument, cut, worded
from poseppl.files.csv_fields import decimal_number
from poseppl.motion.settings import Kind, ReadFrom, Reads, Settings, Within, kinds_of
from poseppl.runs.settings import texts_of

Command = TypeVar("Command", bound=Callable[..., Any])
Made = TypeVar("Made", bound=Settings)
Option = Callable[[Any], Any]


def option_group(*given: Option) -> Callable[[Command], Command]:
    """Make one decorator of several options, which help lists in this order."""

    def decorate(command: Command) -> Command:
        for option in reversed(given):
            command = option(command)
        return command

    return decorate


def seed_option(purpose: str | None = None) -> Option:
    """The option --seed."""
    return click.option("--seed", metavar="N", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help=purpose)


def chosen(options: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Some of the options, as arguments of the same names."""
    return {name: options[name] for name in names}


class Grouped(click.Option):
    """An option that help lists in a section of its own."""

    section = "Options"


def options_of(settings: type[Settings], *names: str, section: str = "Options") -> list[Option]:
    """Options of the fields of settings, with the texts of their docstrings.

    Args:
        settings: The settings.
        names: Names of the fields; all but the first, which is an argument, if none is given.
        section: Section of the help that lists them.
    """
    kind = type("OptionOf", (Grouped,), {"section": section})
    own = {each.name: each for each in fields(settings)}
    return [
        click.option(f"--{name.replace('_', '-')}", name, cls=kind, **_declared(settings, own[name]))
        for name in names or list(own)[1:]
    ]


def _declared(settings: type[Settings], field: Field[Any]) -> dict[str, Any]:
    """Click's parameters of a field."""
    kind, default = kinds_of(settings)[field.name], field.default
    text, _, usual = text_of(settings, field.name).partition(" Default: ")
    choices = get_args(kind.type) if get_origin(kind.type) is Literal else ()
    words = not isinstance(kind.condition, ReadFrom) and (kind.several or kind.or_file and not kind.condition)
    shown = default if isinstance(default, int | float | str) and not isinstance(default, bool) else usual.rstrip(".")
    listed = f" One of {', '.join(choices)}." if len(choices) > 6 else ""
    how: dict[str, Any] = {"help": f"{text}{listed}" + (f" [default: {shown}]" if shown != "" else "")}
    if kind.type is bool:
        return {**how, "is_flag": True}
    if words:
        callback = _parts_of_words if choices else None
        return {**how, "multiple": True, "metavar": "NAME,..." if choices else "CAMERA:NAME=VALUE", "callback": callback}
    how |= {"metavar": _metavar(kind, choices), "type": _type(kind)}
    if kind.several:
        return {**how, "multiple": True}
    return {**how, "required": True} if default is MISSING else {**how, "default": default}


def text_of(settings: type[Settings], name: str) -> str:
    """Description of a field, from the docstring of its class or of a base class."""
    return next(texts[name] for base in settings.__mro__ if name in (texts := texts_of(base)))


def _parts_of_words(context: click.Context, option: click.Parameter, words: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(part for word in words for part in word.split(","))


def _metavar(kind: Kind, choices: Sequence[str]) -> str:
    match kind.condition:
        case ReadFrom():
            return "FILE..." if kind.several else "FILE"
        case Within(unit=unit):
            return (unit.upper() or ("N" if kind.type is int else "NUMBER")) + "|FILE" * kind.or_file
        case Reads(metavar=metavar):
            return metavar
    return f"[{'|'.join(choices)}]" if 0 < len(choices) <= 6 else "NAME"


def _type(kind: Kind) -> Any:
    """Click's type of a value; settings check it when they are created."""
    match kind.condition:
        case ReadFrom(folders=folders):
            return InputFile(folders=folders, paths=file_of_pair)
        case Within():
            return _NumberOrFile() if kind.or_file else click.INT if kind.type is int else click.FLOAT
    return BUILDER if kind.condition == "builder" else click.STRING


class _NumberOrFile(InputFile):
    """A number, or else a file that is read."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read it, as click does."""
        number = decimal_number(str(value))
        return super().convert(value, param, ctx) if number is None else number

    def check(self, word: Any, option: str) -> None:
        """Refuse a file that cannot be read."""
        if not isinstance(word, int | float):
            super().check(word, option)


def made(settings: type[Made], given: Mapping[str, Any]) -> Made:
    """Settings of the options that were given.

    Raises:
        InputError: A value is not accepted.
    """
    wanted = {each.name: given[each.name] for each in fields(settings) if each.name in given}
    return settings(**{name: value for name, value in wanted.items() if value is not None and value != ()})


max_draws_option = click.option(
    "--max-draws",
    metavar="N",
    type=click.IntRange(1),
    help="Draws stored of each chain, or of all particles; means and intervals always use all of them. "
    "[default: as many as fit into 256 MiB]",
)


history_option = click.option(
    "--history-mib",
    metavar="MIB",
    type=click.FloatRange(0),
    default=256.0,
    show_default=True,
    help="Space in the result for the particles or Gaussians from which smoothers start. 0 stores none; a run that needs more "
    "stores none and reports it.",
)


def _alone(context: click.Context, option: click.Parameter, address: str | None) -> str | None:
    if address and context.params["workers"] is not None:
        raise click.UsageError("--workers does not go with --scheduler")
    return address


worker_options = option_group(
    click.option(
        "--workers", metavar="N", type=click.IntRange(1), is_eager=True, help="Number of processes. [default: one per core]"
    ),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        callback=_alone,
        help="Dask scheduler, such as tcp://host:8786, instead of processes; its workers read and write these folders.",
    ),
)
"""Executor of the jobs."""


def result_options(folder: str, model: str) -> Callable[[Command], Command]:
    """Options that commands on a smoothed or tracked result of a body share.

    Args:
        folder: Help of --output, without its default.
        model: Help of --model, without its default.
    """
    return option_group(
        click.option("--output", "-o", metavar="FOLDER", type=click.Path(), help=f"{folder} [default: beside RESULT]"),
        click.option(
            "--level",
            metavar="SHARE",
            type=number("a share between 0 and 1, such as 0.9", lambda level: 0 < level < 1),
            default=0.9,
            show_default=True,
            help="Probability of the intervals.",
        ),
        click.option(
            "--model", metavar="BUILDER", type=BUILDER, help=f"{model} [default: the installed body that RESULT names]"
        ),
    )


common_options = option_group(
    click.option("--quiet", "-q", is_flag=True, help="No progress and no table; warnings are still printed."),
)
"""How much is said."""


BY_SET = ("sigma_position", "sigma_angle", "markers", "other_motion", "history_mib", "on_failure", "devices", "export")
"""Settings of a track that `--set` gives, as it gives those of the algorithm."""
POSITIONAL = ("files", "videos", "recording", "observations")
"""Arguments of commands that are no options."""


def as_option(argument: Argument) -> str:
    """An argument and its value as an option."""
    name, value = argument.name, argument.value
    if name in POSITIONAL:
        return name.upper()
    if argument.setting or name in BY_SET:
        return f"--set {name}" + ("" if value is None else f"={cut(value)}")
    return f"--{name.replace('_', '-')}" + ("" if value in (None, True) else f" {cut(value)}")


def as_options(message: object) -> str:
    """A message, or an error, that names options."""
    return worded(message, as_option)
