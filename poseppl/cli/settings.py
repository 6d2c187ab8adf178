"""Settings of algorithms on the command line: `--set NAME=VALUE`, and the commands that list them.

All is read from the signatures of what :mod:`poseppl.filters`, :mod:`poseppl.smoothers` and :mod:`poseppl.fitting` export.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import click

from poseppl.cli.checks import check_inputs
from poseppl.errors import InputError


def _assignments(context: click.Context, option: click.Parameter, words: tuple[str, ...]) -> dict[str, str]:
    pairs = [word.partition("=") for word in words]
    for name, _, value in pairs:
        if not name or not value:
            raise click.BadParameter("expected NAME=VALUE, such as num_chains=50")
    return {name.strip(): value.strip() for name, _, value in pairs}


def assignments_option(option: str, name: str, purpose: str) -> Callable[[Any], Any]:
    """An option of words NAME=VALUE, given to the command as a mapping."""
    return click.option(option, name, metavar="NAME=VALUE", multiple=True, callback=_assignments, help=purpose)


settings_option = assignments_option(
    "--set",
    "settings",
    "A setting of the algorithm; may be given several times. poseppl filters NAME, or smoothers NAME, lists them.",
)
"""`--set NAME=VALUE`, given to the command as the mapping `settings`."""


class CommandWithSettings(click.Command):
    """A command that takes `--set`; an unknown option that is called like a setting is answered with it."""

    kind = "filter"

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, as click does."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            word = error.option_name.lstrip("-").replace("-", "_")
            hints = [f"--set {name}=" for name in sorted(self.settings()) if word in name]
            if not hints and (hint := self.elsewhere(error.option_name)):
                raise click.UsageError(hint, ctx) from error
            raise click.NoSuchOption(error.option_name, possibilities=hints or error.possibilities, ctx=ctx) from error

    def settings(self) -> set[str]:
        """Names of the settings of all algorithms."""
        known = _algorithms(self.kind)
        return {setting for name in known for setting in known.described(name).settings}

    def elsewhere(self, option: str) -> str | None:
        """A message on an option that other commands have; None where none has it."""
        return None


class ManyFiles(CommandWithSettings):
    """A command whose options of several files take all the words up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each of its words."""
        several = [option for option in self.params if isinstance(option, click.Option) and isinstance(option.type, click.Path)]
        many = {name for option in several if option.multiple for name in option.opts}
        spread: list[str] = []
        taking: str | None = None
        for word in args:
            if word.startswith("-"):
                taking = word if word in many else None
            spread += [] if word == taking else [word] if taking is None else [taking, word]
        return super().parse_args(ctx, spread)


def _algorithms(kind: str) -> Any:
    from poseppl.runs.algorithms import FILTERS, SMOOTHERS, Algorithms

    return {"filter": FILTERS, "smoother": SMOOTHERS, "method": Algorithms("method", "poseppl.fitting")}[kind]


def check_algorithm(kind: str, name: str, settings: Mapping[str, str] | None = None) -> None:
    """Refuse a filter or a smoother that there is not, and settings of other names or types than its own.

    No algorithm is imported for that; ranges are checked where it is built.

    Args:
        kind: "filter" or "smoother".
        name: Its name.
        settings: Values as words.

    Raises:
        InputError: There is none of this name.
        SettingError: A setting cannot be used.
    """
    _algorithms(kind).described(name).complete(settings or {})


def filter_of_prior(path: str, settings: Mapping[str, str]) -> str:
    """The usual filter of a learned motion, whose file is read after words that none of them takes are refused.

    Raises:
        InputError: The file cannot be read, or a setting cannot be used.
    """
    try:
        check_algorithm("filter", "particle", settings)
    except InputError:
        check_algorithm("filter", "switching", settings)
    check_inputs()

    from poseppl.motion.learned import read_learned_motion
    from poseppl.motion.tracking.learned_prior import filter_of

    name = filter_of(read_learned_motion(path))
    check_algorithm("filter", name, settings)
    return name


def listing(kind: str, option: str, example: str) -> click.Command:
    """The command that lists the algorithms of a kind, or the settings of one."""
    examples = f"""
\b
Examples:
  poseppl {kind}s              all, each with a sentence, its settings, their types and defaults
  poseppl {kind}s {example:12} one, and what each of its settings is

\b
Files written: none.

\b
Exit status: 0 done, 1 no such {kind}, 2 wrong usage.
"""

    @click.command(f"{kind}s", epilog=examples, short_help=f"List the {kind}s and their settings.")
    @click.argument("name", required=False)
    def show(name: str | None) -> None:
        _list(_algorithms(kind), name)

    show.help = f"List the {kind}s that {option} names, with the settings that --set takes; or those of the one called NAME."
    return show


def _list(algorithms: Any, name: str | None) -> None:
    formatter = click.HelpFormatter(max_width=100)
    for algorithm in map(algorithms.described, algorithms if name is None else [name]):
        settings = list(algorithm.settings.values())
        with formatter.section(algorithm.name):
            formatter.write_text(algorithm.summary)
            if name is None and settings:
                formatter.write_text(", ".join(setting.shown.replace(" ", "\N{NO-BREAK SPACE}") for setting in settings))
            elif settings:
                formatter.write_paragraph()
                formatter.write_dl([(setting.shown, setting.text) for setting in settings])
    click.echo(formatter.getvalue().replace("\N{NO-BREAK SPACE}", " ").strip())


filters = listing("filter", "poseppl track --filter", "hmc")
smoothers = listing("smoother", "poseppl smooth --method", "trajectory")
methods = listing("method", "poseppl fit --method", "nuts")
