"""Commands in the documentation and in the help exist, with the options that they name; one page names all commands."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from poseppl.cli import cli

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted((ROOT / "docs").rglob("*.md"))
SPELLED = re.compile(r"(?<![\w./-])poseppl ([a-z](?:(?!  )[^`\n|;&#])*)")
CODE = re.compile(r"`[^`]+`|^(?:    |\$ )?poseppl .*$|^    .*poseppl .*$", re.MULTILINE)


def commands_in(text: str) -> list[list[str]]:
    """Words of each command in the code of a page."""
    joined = re.sub(r"\\\n\s*", " ", text)
    return [
        example.split()
        for code in CODE.findall(joined)
        for example in SPELLED.findall(code)
        if example.split()[0] in cli.commands
    ]


def helps(command: click.Command = cli, parent: click.Context | None = None) -> Iterator[str]:
    """The examples in the help of a command and of all below it. A command keeps the help options of its first context."""
    context = click.Context(command, parent, terminal_width=500, **{**cli.context_settings, "max_content_width": 500})
    yield command.get_help(context).partition("Examples:")[2]
    for below in getattr(command, "commands", {}).values():
        yield from helps(below, context)


def command_of(words: list[str]) -> click.Command:
    """The command that a line's first words name."""
    command: click.Command = cli
    for word in words:
        below = command.commands.get(word) if isinstance(command, click.Group) else None
        if below is None:
            break
        command = below
    return command


def unknown_options(words: list[str]) -> set[str]:
    """Options of a line that its command does not have; without a source, track has those of all sources."""
    command = command_of(words)
    several = [command, *getattr(command, "commands", {}).values()]
    known = {option for each in several for parameter in each.params for option in (*parameter.opts, *parameter.secondary_opts)}
    return {word for word in re.findall(r"(?<!\S)--[\w-]+", " ".join(words))} - known - {"--help"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_on_a_page_have_the_options_that_it_names(page: Path) -> None:
    found = {" ".join(words): unknown_options(words) for words in commands_in(page.read_text(encoding="utf-8"))}
    assert not {line: options for line, options in found.items() if options}


def test_commands_in_the_help_have_the_options_that_it_names() -> None:
    found = {" ".join(words): unknown_options(words) for text in helps() for words in commands_in(text)}
    assert len(found) > 20
    assert not {line: options for line, options in found.items() if options}


def test_the_page_of_commands_has_all() -> None:
    named = {words[0] for words in commands_in((ROOT / "docs" / "commands.md").read_text(encoding="utf-8"))}
    assert {name for name, command in cli.commands.items() if not command.hidden} == named


def test_the_citation_has_the_version_of_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {project['version']}\n" in citation
