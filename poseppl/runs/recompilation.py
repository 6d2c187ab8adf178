"""Hints at compilations that would not be needed: functions that are defined again for every run.

JAX cannot know that two functions do the same, and compiles for each. Builders of poseppl return the same object for equal
settings (:mod:`poseppl.program.memoized_builder`); a lambda in a loop is another object each time, which is said once.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable
from types import CodeType, FunctionType
from typing import Any

from poseppl.filters.base import Filter

_LOGGER = logging.getLogger("poseppl")
_DEPTH = 4
"""Functions within closures of functions that are compared."""


class _Owner:
    """Owner that filters are compared under, as collectors are under their filter."""


_ANY = _Owner()
_seen: weakref.WeakKeyDictionary[Any, dict[int, weakref.ref[Any]]] = weakref.WeakKeyDictionary()
_told: set[CodeType] = set()


def tell_filter_defined_anew(filter: Filter) -> None:
    """Say once that a filter is compiled for whose functions are those of an earlier one, defined again."""
    if isinstance(filter.step, FunctionType) and _is_anew(_ANY, filter.step, also=filter.init):
        _tell(filter.step, "filter", "build it once, outside of the loop, or decorate its builder with memoized_builder")


def warn_recompilation(owner: Any, what: str, function: Callable[..., Any] | None) -> None:
    """Say once that a function is compiled for that is the same as an earlier one, defined again.

    Args:
        owner: The filter or smoother that it is used with.
        what: Name of it, for the message.
        function: The function.
    """
    if isinstance(function, FunctionType) and _is_anew(owner, function):
        _tell(function, what, "define it once, outside of the loop; collect_draws returns the same one for equal settings")


def _is_anew(owner: Any, function: FunctionType, also: Any = None) -> bool:
    known = _seen.setdefault(owner, {})
    fingerprint = hash((_fingerprint(function, _DEPTH), _fingerprint(also, _DEPTH)))
    earlier = known.get(fingerprint)
    known[fingerprint] = weakref.ref(function)
    return earlier is not None and earlier() is not function


def _tell(function: FunctionType, what: str, cure: str) -> None:
    code = function.__code__
    if code not in _told:
        _told.add(code)
        _LOGGER.warning(
            "compiling again: the %s %s (%s:%d) does what an earlier one did, but is another object; %s",
            what,
            code.co_qualname,
            code.co_filename,
            code.co_firstlineno,
            cure,
        )


def _fingerprint(value: Any, depth: int) -> int:
    """A number that is equal for functions of the same code over the same variables."""
    if isinstance(value, FunctionType):
        if not depth:
            return 0
        cells = [cell.cell_contents for cell in value.__closure__ or () if _is_filled(cell)]
        parts = [*cells, *(value.__defaults__ or ()), *(value.__kwdefaults__ or {}).values()]
        return hash((value.__code__, *(_fingerprint(part, depth - 1) for part in parts)))
    try:
        return hash(value)
    except TypeError:
        return id(value)


def _is_filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is not cell
    except ValueError:
        return False
