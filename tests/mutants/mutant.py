"""Mutants: one-line mistakes that an expert could make, as patches, each with the tests that must notice it.

A patch begins with a header of the lines `wrong:` (what is wrong), and either `test:` (the ids of tests one of which must fail;
the cheapest will do) or `reason:` (why no test of behaviour can notice it). The name is that of the file.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PATCHES = Path(__file__).parent / "patches"
_PARTS = ("poseppl", "models", "tests", "benchmarks", "docs", "notebooks", "pyproject.toml", "README.md", "CHANGELOG.md")


class Mutant(NamedTuple):
    """One patch.

    Attributes:
        name: Of the file.
        patch: The file.
        wrong: What is wrong.
        tests: Ids of the tests that must notice it; none where there is a reason.
        reason: Why none can.
    """

    name: str
    patch: Path
    wrong: str
    tests: tuple[str, ...]
    reason: str


def read_mutants(names: list[str] | None = None) -> list[Mutant]:
    """All mutants by name, or those named.

    Raises:
        ValueError: A header that is not as it should be, or an unknown name.
    """
    mutants = [_read(patch) for patch in sorted(PATCHES.glob("*.patch"))]
    unknown = set(names or ()) - {mutant.name for mutant in mutants}
    if unknown:
        raise ValueError(f"no mutant is called {', '.join(sorted(unknown))}; they are the files of {PATCHES}")
    return [mutant for mutant in mutants if not names or mutant.name in names]


def _read(patch: Path) -> Mutant:
    header = patch.read_text().split("\n--- ", 1)[0]
    found: dict[str, list[str]] = {"wrong": [], "test": [], "reason": []}
    for line in header.splitlines():
        match = re.fullmatch(r"(wrong|test|reason): (\S.*)", line)
        if match is None:
            raise ValueError(f"{patch.name}: {line!r} is not a line of a header. Expected wrong:, test: or reason: and a text")
        found[match[1]].append(match[2])
    if len(found["wrong"]) != 1 or bool(found["test"]) == bool(found["reason"]):
        raise ValueError(f"{patch.name}: expected one line wrong:, and either lines test: or lines reason:")
    return Mutant(patch.stem, patch, found["wrong"][0], tuple(found["test"]), " ".join(found["reason"]))


def copy_tree(folder: Path) -> Path:
    """Copy the sources into a folder, in which patches can be applied."""
    for part in _PARTS:
        source, target = ROOT / part, folder / part
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("patches", "*.egg-info"))
        elif source.is_file():
            shutil.copy2(source, target)
    return folder


def apply(mutant: Mutant, folder: Path, *, check: bool = False) -> str:
    """Apply a patch to a copy of the sources, or only check that it would apply; what git complains of, if anything."""
    command = ["git", "apply", "--recount", *(["--check"] if check else []), str(mutant.patch)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=_without_repository())
    return done.stderr.strip() if done.returncode else ""


def _without_repository() -> dict[str, str]:
    """An environment in which git takes a folder as it is, and not as part of a repository above it."""
    return {**os.environ, "GIT_CEILING_DIRECTORIES": "/", "GIT_DIR": os.devnull}
