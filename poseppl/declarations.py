"""Declarations of a module of poseppl, read from its source without importing it: the command line checks words so, at once.

A function has its arguments and its docstring, and returns nothing; a NamedTuple has its fields; a constant its value, if it
is made of such. Other classes, and what comes from other packages than ours, ``typing``, ``collections`` and ``functools``,
are :class:`Foreign`.

>>> chains = declared("poseppl.filters", "hmc_filter").__annotations__["settings"]
>>> chains().num_leapfrog
40
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_OURS = ("poseppl", "poseppl_papers")
_READ = ("typing", "collections", "functools")


class _Attributes(type):
    """The attributes of a foreign name are foreign, too."""

    def __getattr__(cls, name: str) -> type[Foreign]:
        if name.startswith("_"):
            raise AttributeError(name)
        return Foreign


class Foreign(metaclass=_Attributes):
    """Stands for a class or a module that is not made."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take any arguments."""

    def __class_getitem__(cls, item: Any) -> type[Foreign]:
        """Take any parameters, as types have them."""
        return cls


def declared(module: str, name: str) -> Any:
    """The declaration of a name in a module of poseppl.

    Raises:
        AttributeError: It declares no such name.
    """
    found = _declarations(module)
    if name not in found.names:
        raise AttributeError(f"module {module!r} declares no {name!r}")
    return found.value(name)


def names_declared(module: str) -> list[str]:
    """The names that a module of poseppl declares, in their order."""
    return list(_declarations(module).names)


@cache
def _folder(package: str) -> Path:
    """The folder of a package, which is not imported."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(package)
    return Path(spec.origin).parent


class _Declarations:
    """The statements of a module by the names that they declare, each made when it is asked for."""

    def __init__(self, module: str) -> None:
        package, *rest = module.split(".")
        path = _folder(package).joinpath(*rest)
        self._path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        self._made: dict[str, Any] = {"__name__": module}
        tree = ast.parse(self._path.read_text(encoding="utf-8"))
        self.names = {name: statement for statement in tree.body for name in _names_of(statement)}

    def value(self, name: str) -> Any:
        """Make what a name stands for, and what that needs."""
        if name not in self._made:
            self._make(name, self.names[name])
        return self._made[name]

    def _make(self, name: str, statement: ast.stmt) -> None:
        if isinstance(statement, ast.Import | ast.ImportFrom):
            self._made[name] = _imported(name, statement)
            return
        if isinstance(statement, ast.ClassDef) and "NamedTuple" not in map(ast.unparse, statement.bases):
            self._made[name] = Foreign
            return
        self._made[name] = Foreign  # where it needs itself
        bare = _bare(statement)
        for each in ast.walk(bare):
            if isinstance(each, ast.Name) and each.id in self.names:
                self.value(each.id)
        exec(compile(ast.Module([bare], []), str(self._path), "exec", dont_inherit=True), self._made)


_declarations = cache(_Declarations)


def _names_of(statement: ast.stmt) -> Iterator[str]:
    match statement:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
            yield name
        case ast.Assign(targets=targets):
            yield from (each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name))
        case ast.Import(names=names) | ast.ImportFrom(names=names):
            yield from (each.asname or each.name for each in names)


def _imported(name: str, statement: ast.Import | ast.ImportFrom) -> Any:
    place = (statement.module or "") if isinstance(statement, ast.ImportFrom) else ""
    (original,) = (each.name for each in statement.names if name == (each.asname or each.name))
    package = place.partition(".")[0]
    if package in _OURS:
        return declared(place, original)
    return getattr(import_module(place), original) if package in _READ else Foreign


def _bare(statement: ast.stmt) -> ast.stmt:
    """A function's arguments and docstring, a class without its methods."""
    if not isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return statement
    if isinstance(statement, ast.FunctionDef):
        statement.returns = None
    fields = [each for each in statement.body if isinstance(each, ast.AnnAssign) and isinstance(statement, ast.ClassDef)]
    text = ast.get_docstring(statement, clean=False) or ""
    statement.decorator_list, statement.body = [], [ast.parse(repr(text)).body[0], *fields]
    return statement
