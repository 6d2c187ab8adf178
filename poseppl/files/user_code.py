"""Python that the user names: a module, or a file. Importing it runs it, so nothing but the user's own word names it."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType

from poseppl.errors import Argument, InputError, brief


def import_named(place: str, field: str | Argument) -> ModuleType:
    """Import ``package.module`` or ``file.py``.

    Args:
        place: The module's name, or the file.
        field: The argument that named it, for messages.

    Raises:
        InputError: There is no such module or file, or importing it fails.
    """
    try:
        return _load_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except Exception as error:  # the module's own code raises anything at all
        raise InputError(f"cannot import {brief(place)}: {error}", field=field) from error


def file_of_module(name: str) -> str:
    """The file of ``package.module``; nothing if there is none, which importing it reports."""
    try:
        spec = importlib.util.find_spec(name)
    except Exception:  # the code of a package around it raises anything at all
        spec = None
    return "" if spec is None or spec.origin is None else spec.origin


def _load_file(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ImportError(f"no such file: {path}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
