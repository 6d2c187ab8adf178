"""Versions of what decides a result: libraries by their releases, poseppl's own by the hash of its source besides."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

_PACKAGES = ("poseppl", "jax", "jaxlib", "numpyro", "blackjax", "numpy")
_SOURCES = ("poseppl", "poseppl_models", "poseppl_papers")
_NOT_IN_RESULTS = ("cli", "report")
"""Folders of poseppl whose code decides no result of a job."""


@cache
def versions() -> dict[str, str]:
    """Versions by the name of the package; poseppl's ends with the first digits of :func:`source_hash`."""
    found = {name: version(name) for name in _PACKAGES}
    return found | {"poseppl": f"{found['poseppl']}+{source_hash(_folders())[:12]}"}


def source_hash(folders: Iterable[Path]) -> str:
    """Hash the Python files and data files of packages, without those that decide no result.

    Args:
        folders: Those of the packages.

    Returns:
        64 hexadecimal digits, which do not depend on where the folders are.
    """
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            parts = file.relative_to(folder).parts
            if file.suffix in (".py", ".json") and parts[0] not in _NOT_IN_RESULTS:
                content = file.read_bytes()
                digest.update(f"{folder.name}/{'/'.join(parts)} {len(content)}\n".encode())
                digest.update(content)
    return digest.hexdigest()


def _folders() -> list[Path]:
    places = [spec.submodule_search_locations for name in _SOURCES if (spec := find_spec(name)) is not None]
    return [Path(place) for found in places for place in found or ()]
