"""The reference of the command line: the help of every command, as click writes it."""

from __future__ import annotations

from collections.abc import Iterator

import click

from poseppl.cli import cli

WIDTH = 88


def page() -> str:
    """The page, in Markdown: one section for each command and sub-command."""
    lines = ["# Command line", "", "The help of every command. `poseppl COMMAND --help` prints the same."]
    for name, command in commands(cli, "poseppl"):
        lines += ["", f"## {name}", "", "```text", help_of(name, command), "```"]
    return "\n".join([*lines, ""])


def commands(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    """A command and all below it, with their full names, in the order of their help."""
    yield name, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=name)
        for each in command.list_commands(context):
            below = command.get_command(context, each)
            if below is not None and not below.hidden:
                yield from commands(below, f"{name} {each}")


def help_of(name: str, command: click.Command) -> str:
    """The help of a command, as on a terminal."""
    context = click.Context(command, info_name=name, max_content_width=WIDTH, terminal_width=WIDTH)
    return command.get_help(context).rstrip()
