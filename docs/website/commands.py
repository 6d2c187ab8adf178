"""The reference of the command line: the help of every command, as click writes it."""

from __future__ import annotations

from collections.abc import Iterator

import click

from poseppl.cli import cli

WIDTH = 88
HELP = cli.context_settings["help_option_names"]


def page() -> str:
    """The page, in Markdown: one section for each command and sub-command."""
    lines = ["# Command line", "", "The help of every command. `poseppl COMMAND --help` prints the same."]
    for context in contexts():
        lines += ["", f"## {context.command_path}", "", "```text", context.get_help().rstrip(), "```"]
    return "\n".join([*lines, ""])


def contexts(
    command: click.Command = cli, name: str = "poseppl", parent: click.Context | None = None
) -> Iterator[click.Context]:
    """The context of a command and of all below it, in the order of their help, with the settings of the command line."""
    context = click.Context(command, parent, name, max_content_width=WIDTH, terminal_width=WIDTH, help_option_names=HELP)
    yield context
    if isinstance(command, click.Group):
        for each in command.list_commands(context):
            below = command.get_command(context, each)
            if below is not None and not below.hidden:
                yield from contexts(below, each, context)
