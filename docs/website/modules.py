"""Modules of the reference: which have a page, and where a name that a package exports is defined."""

from __future__ import annotations

import ast
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

PACKAGES = (
    "poseppl",
    "poseppl.program",
    "poseppl.filters",
    "poseppl.smoothers",
    "poseppl.kernels",
    "poseppl.runs",
    "poseppl.diagnostics",
    "poseppl.report",
    "poseppl.particles",
    "poseppl.gaussians",
    "poseppl.motion.bodies",
    "poseppl.motion.geometry",
    "poseppl.motion.io",
    "poseppl.motion.learned",
    "poseppl.motion.likelihoods",
    "poseppl.motion.rendering",
    "poseppl.motion.keypoints",
    "poseppl.motion.points",
    "poseppl.motion.recordings",
    "poseppl.motion.silhouettes",
    "poseppl.motion.tracking",
    "poseppl.motion.verdicts",
    "poseppl.motion.vision",
    "poseppl_models",
    "poseppl_models.bodies",
    "poseppl_models.toys",
    "poseppl_models.images",
    "poseppl_models.bodytrack",
    "poseppl_models.darby",
    "poseppl_models.du_guan",
    "poseppl_models.peursum",
    "poseppl_models.sminchisescu_triggs",
)


class Export(NamedTuple):
    """A name that a package exports, and the module that defines it."""

    name: str
    module: str


@cache
def source_of(module: str) -> Path:
    """The file of a module, which is not run."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(module)
    return Path(spec.origin)


@cache
def exports(package: str) -> tuple[Export, ...]:
    """Names that a package's file imports as themselves, each with the module that defines it."""
    found = {}
    for node in ast.walk(ast.parse(source_of(package).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("poseppl"):
            found |= {
                each.name: Export(each.name, _home(node.module, each.name)) for each in node.names if each.name == each.asname
            }
    return tuple(found[name] for name in sorted(found, key=str.lower))


def _home(module: str, name: str) -> str:
    if source_of(module).name == "__init__.py":
        return next((each.module for each in exports(module) if each.name == name), module)
    return module


@cache
def modules_of(package: str) -> tuple[str, ...]:
    """Modules of a package that have a page: those that define what it exports; all of them if it exports nothing."""
    if package == "poseppl":
        return ()
    named = {each.module for each in exports(package)}
    if not named:
        files = source_of(package).parent.glob("*.py")
        named = {f"{package}.{file.stem}" for file in files if not file.stem.startswith("_")}
    return tuple(sorted(each for each in named if each.startswith(f"{package}.")))


def alone() -> list[str]:
    """Modules with a page that lie in no package of the list: the errors, and what packages export from elsewhere."""
    inside = {*PACKAGES, *(module for package in PACKAGES for module in modules_of(package))}
    return sorted({"poseppl.errors", *(each.module for package in PACKAGES for each in exports(package))} - inside)


def all_modules() -> list[str]:
    """Every module with a page that is no package of the list."""
    return sorted({*alone(), *(module for package in PACKAGES for module in modules_of(package))} - {*PACKAGES})


def first_sentence(module: str, name: str | None = None) -> str:
    """The first line of the docstring of a module, or of what it calls so; empty without one."""
    imported = import_module(module)
    documented = imported if name is None else getattr(imported, name)
    if name is not None and not (isinstance(documented, type) or callable(documented)):
        return ""
    return ((documented.__doc__ or "").strip().splitlines() or [""])[0]
