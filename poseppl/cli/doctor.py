"""The command `poseppl doctor`: what is installed, what is missing, where caches are, what devices there are."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import NamedTuple

import click

from poseppl.files.cache_folder import cache_folder, xla_folder

FOR_DEVELOPERS = ("dev", "opensim", "site", "test")
"""Extras that no command needs."""
SERVES = {
    "mocap": "writing C3D: poseppl export --format c3d",
    "tables": "tables in Parquet, for poseppl run",
    "experiments": "poseppl reproduce",
    "vision": "track videos, masks, overlays",
    "motion-models": "poseppl fit-motion",
    "render": "simulate --video",
    "rerun": "poseppl export --format rrd",
    "opensim": "tests of what is exported for OpenSim",
}
"""The use of each extra; one that is not listed is shown all the same."""
EPILOG = """
\b
Examples:
  poseppl doctor             all that is known
  poseppl doctor --no-jax    without starting JAX, which takes a second or two

\b
Files written: none.

\b
Exit status: 0 what poseppl needs is there (extras may be missing), 1 it is not, 2 wrong usage.
"""


class Requirement(NamedTuple):
    """A package that poseppl, or one of its extras, needs.

    Attributes:
        name: Its name.
        bound: The releases that will do, such as ``>=3.10``.
        extra: The extra; empty for what is always needed.
        installed: Its version; None if it is not installed.
    """

    name: str
    bound: str
    extra: str
    installed: str | None


def requirements(declared: Iterable[str]) -> Iterator[Requirement]:
    """Requirements as a package's metadata declare them, with what is installed of each.

    >>> next(requirements(['nowhere-to-be-found[all]>=2.0; extra == "mocap"']))
    Requirement(name='nowhere-to-be-found', bound='>=2.0', extra='mocap', installed=None)
    """
    for each in declared:
        wanted, _, marker = each.partition(";")
        parts = re.match(r"\s*([\w.-]+)\s*(?:\[[^\]]*\])?\s*\(?([^)\s]*)\)?", wanted)
        extra = re.search(r"extra\s*==\s*['\"]([\w.-]+)['\"]", marker)
        if parts:
            yield Requirement(parts[1], parts[2], extra[1] if extra else "", _version_of(parts[1]))


def _version_of(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def missing_extras(found: Iterable[Requirement]) -> dict[str, list[str]]:
    """Extras by name, each with the packages of it that are not installed; an empty list where none is missing."""
    extras: dict[str, list[str]] = {}
    for each in found:
        if each.extra and each.extra not in FOR_DEVELOPERS and each.name != "poseppl":
            extras.setdefault(each.extra, []).extend([each.name] if each.installed is None else [])
    return extras


@click.command(epilog=EPILOG, short_help="Check the installation: packages, missing extras, caches.")
@click.option("--jax/--no-jax", default=True, help="Whether to start JAX and list its devices.")
def doctor(jax: bool) -> int:
    """List what is installed, which extras are missing and how to get them, where caches are, and JAX's devices."""
    from poseppl.cli.console import print_table

    own = _version_of("poseppl")
    found = list(requirements((requires("poseppl") or []) if own else []))
    needed = [each for each in found if not each.extra]
    print_table("poseppl", [("version", own or "not installed: it runs from a folder"), *_place()])
    rows = [(each.name, each.bound, each.installed or "MISSING") for each in needed]
    print_table("Needed", rows, ("package", "wanted", "found"))
    print_table("Extras", list(_extra_rows(missing_extras(found))), ("extra", "for", "state"))
    print_table("Programs", [(name, shutil.which(name) or "not found") for name in ("ffmpeg", "chromium")])
    print_table("Kept where", list(_folders()))
    if jax:
        print_table("JAX", list(_devices()))
    return int(any(each.installed is None for each in needed))


def _place() -> Iterator[tuple[str, str]]:
    yield "Python", f"{platform.python_version()}, {sys.executable}"
    yield "machine", f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def _extra_rows(extras: dict[str, list[str]]) -> Iterator[tuple[str, str, str]]:
    for name, missing in extras.items():
        state = f"lacks {', '.join(missing)}: pip install 'poseppl[{name}]'" if missing else "installed"
        yield name, SERVES.get(name, ""), state


def _folders() -> Iterator[tuple[str, str]]:
    yield "XLA's compilations", _described(xla_folder())
    yield "compiled programs", _described(cache_folder("programs"))
    yield "rendered scenes", _described(cache_folder("scenes"))
    data = os.environ.get("POSEPPL_DATA")
    yield "recordings of the tests (POSEPPL_DATA)", _described(Path(data)) if data else "not set"


def _described(folder: Path) -> str:
    """A folder, and what can be said of it without looking at more than its first level."""
    if not folder.is_dir():
        return f"{folder}: not there yet"
    files = [entry.stat().st_size for entry in os.scandir(folder) if entry.is_file(follow_symlinks=False)]
    writable = "" if os.access(folder, os.W_OK) else ", cannot be written"
    return f"{folder}: {len(files):,} files, {sum(files) / 2**20:,.0f} MiB{writable}"


def _devices() -> Iterator[tuple[str, str]]:
    import jax

    try:
        devices = jax.devices()
    except RuntimeError as error:
        yield "devices", f"none: {str(error).splitlines()[0]}"
        return
    yield "devices", ", ".join(f"{device.platform}:{device.id} {device.device_kind}" for device in devices)
    yield "precision", str(jax.numpy.zeros(()).dtype)
