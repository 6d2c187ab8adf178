"""Settings of algorithms, read from the signatures and docstrings of the functions that build them.

A setting is an argument that is a number, a word or a flag, or such a field of an argument that is a NamedTuple, by the field's
own name; an argument goes before a field of the same name. All else (arrays, programs) is for Python alone.

>>> class Chains(NamedTuple):
...     num_updates: int = 32
...     target_acceptance: float | None = 0.85
>>> def example_filter(model: object, num_chains: int = 10, settings: Chains = Chains(num_updates=24)) -> None:
...     '''An example.'''
>>> {name: setting.default for name, setting in settings_of(example_filter).items()}
{'num_chains': 10, 'num_updates': 24, 'target_acceptance': 0.85}
>>> arguments_of(example_filter, {"num_chains": 50, "target_acceptance": None})
{'num_chains': 50, 'settings': Chains(num_updates=24, target_acceptance=None)}
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from inspect import Parameter, getdoc, signature
from math import isfinite
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from poseppl.errors import SettingError

_LARGEST = 2**31
"""Whole numbers below it are those of the arrays."""


class Setting(NamedTuple):
    """A setting of an algorithm.

    Attributes:
        name: The argument's name, or the field's.
        kind: Its type: bool, int, float, str, or a ``Literal`` of words.
        optional: Whether it may be None.
        default: Its default.
        text: Description, from the docstring.
        inside: The argument that it is a field of; None for an argument.
    """

    name: str
    kind: Any
    optional: bool
    default: Any
    text: str
    inside: str | None = None

    @property
    def type_name(self) -> str:
        """Its type in short, such as ``int`` or ``exact|linear``."""
        kinds = get_args(self.kind) or (self.kind.__name__,)
        return "|".join((*kinds, *(["none"] if self.optional else [])))

    @property
    def shown(self) -> str:
        """Name, type and default, as a signature has them."""
        default = str(self.default).lower() if self.default is None or self.kind is bool else self.default
        return f"{self.name}: {self.type_name} = {default}"

    @property
    def expected(self) -> str:
        """Values that it may have, in words."""
        words = _WORDS.get(self.kind) or f"one of {', '.join(get_args(self.kind))}"
        return f"{words}, or none" if self.optional else words

    def read(self, given: Any) -> Any:
        """Read a value of its type, or a word that tells one.

        Raises:
            SettingError: It is neither.
        """
        if self.optional and (given is None or str(given).lower() == "none"):
            return None
        try:
            return _READERS.get(self.kind, lambda word: get_args(self.kind)[get_args(self.kind).index(word)])(given)
        except (ValueError, TypeError, KeyError) as error:
            raise SettingError(self.name, given, f"expected {self.expected}") from error


def _flag(given: Any) -> bool:
    return {"true": True, "false": False}[str(given).lower()]


def _whole(given: Any) -> int:
    if isinstance(given, bool | float) or abs(int(given)) >= _LARGEST:
        raise ValueError(given)
    return int(given)


def _number(given: Any) -> float:
    if isinstance(given, bool) or not isfinite(float(given)):
        raise ValueError(given)
    return float(given)


_READERS: Mapping[Any, Callable[[Any], Any]] = {bool: _flag, int: _whole, float: _number, str: str}
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}


def settings_of(build: Callable[..., Any]) -> dict[str, Setting]:
    """The settings of a function by name, in the order of its signature: arguments without a default are none."""
    return {setting.name: setting for setting in _settings(build)}


def arguments_of(build: Callable[..., Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """The keyword arguments that stand for settings: fields are gathered in their tuples."""
    known, arguments = settings_of(build), {}
    for name, value in settings.items():
        inside = known[name].inside
        if inside is None:
            arguments[name] = value
        else:
            arguments[inside] = arguments.get(inside, _defaults(build)[inside])._replace(**{name: value})
    return arguments


def summary_of(build: Callable[..., Any]) -> str:
    """The first sentence of a docstring."""
    return re.split(r"(?<=\.)\s", _plain(getdoc(build) or ""), maxsplit=1)[0]


def _settings(build: Callable[..., Any]) -> Iterator[Setting]:
    hints, texts, defaults = get_type_hints(build), texts_of(build), _defaults(build)
    for name, default in defaults.items():
        kind, optional = _kind(hints[name])
        if kind in _READERS or get_origin(kind) is Literal:
            yield Setting(name, kind, optional, default, texts.get(name, ""))
        elif _holds_settings(kind):
            for field, hint in get_type_hints(kind).items():
                kind_inside, optional = _kind(hint)
                if field not in defaults and (kind_inside in _READERS or get_origin(kind_inside) is Literal):
                    yield Setting(field, kind_inside, optional, getattr(default, field), texts_of(kind).get(field, ""), name)


def _defaults(build: Callable[..., Any]) -> dict[str, Any]:
    """The defaults of all arguments that have one; of a tuple that may be None, the tuple's own."""
    hints, found = get_type_hints(build), {}
    for name, parameter in signature(build).parameters.items():
        if parameter.default is Parameter.empty:
            continue
        kind, _ = _kind(hints[name])
        found[name] = kind() if parameter.default is None and _holds_settings(kind) else parameter.default
    return found


def _holds_settings(kind: Any) -> bool:
    """Whether a type is a tuple whose fields all have names and defaults."""
    return bool(getattr(kind, "_fields", ())) and len(kind._fields) == len(kind._field_defaults)


def _kind(hint: Any) -> tuple[Any, bool]:
    """The type, and whether None is another; of several types their union."""
    if get_origin(hint) not in (Union, UnionType):
        return hint, False
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    return (kinds[0], True) if len(kinds) == 1 else (hint, False)


def texts_of(documented: Any) -> dict[str, str]:
    """Texts of a docstring on each argument or attribute."""
    section = re.search(r"^(?:Args|Attributes):\n((?: {4}.*\n?)+)", getdoc(documented) or "", re.MULTILINE)
    items = re.split(r"^ {4}(?=\w+: )", section[1], flags=re.MULTILINE)[1:] if section else []
    return {name: _plain(text) for name, text in (item.split(": ", 1) for item in items)}


def _plain(text: str) -> str:
    """A text in one line, references as what they refer to."""
    return " ".join(re.sub(r":\w+:`~?([\w.]*\.)?(\w+)`", r"\2", text).split())
