"""Filters and smoothers by name: those that :mod:`poseppl.filters` and :mod:`poseppl.smoothers` export.

A name is that of the exported builder without its last word: ``hmc_filter`` is the filter ``hmc``. Settings are those of its
signature (:mod:`poseppl.runs.settings`); values may be words, as a command line has them. Names and settings are read without
importing any algorithm (:mod:`poseppl.declarations`).

>>> FILTERS["hmc"].complete({"num_chains": "50"})["num_chains"]
50
>>> FILTERS["hmc"].complete({"num_chain": 50})
Traceback (most recent call last):
poseppl.errors.SettingError: num_chain=50: no setting of the filter hmc (expected num_chains)
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from functools import cache, partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from poseppl.checks import RangeError
from poseppl.declarations import declared, names_declared
from poseppl.errors import InputError, SettingError, brief
from poseppl.runs.settings import Setting, arguments_of, settings_of, summary_of

if TYPE_CHECKING:
    from poseppl.program import CompiledModel


class Algorithm(NamedTuple):
    """A filter or a smoother that can be chosen by its name.

    Attributes:
        kind: "filter" or "smoother".
        name: Its name.
        builder: `(model, ...) -> algorithm`.
    """

    kind: str
    name: str
    builder: Callable[..., Any]

    @property
    def summary(self) -> str:
        """Its summary, a sentence."""
        return summary_of(self.builder)

    @property
    def settings(self) -> dict[str, Setting]:
        """Its settings by name."""
        return settings_of(self.builder)

    def complete(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """All settings: those that are given, and the defaults of the others.

        Raises:
            SettingError: It has no such setting, or the value is of another type.
        """
        known = self.settings
        for name, value in given.items():
            if name not in known:
                likely = ", ".join(get_close_matches(name, known, 1) or known) or "no settings"
                raise SettingError(name, value, f"no setting of the {self.kind} {self.name} (expected {likely})")
        return {name: setting.read(given[name]) if name in given else setting.default for name, setting in known.items()}

    def build(self, model: CompiledModel, given: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Build it for a model.

        Returns:
            The filter or smoother, and all its settings.

        Raises:
            SettingError: As :meth:`complete`, or a value is out of range.
            InputError: It is not for such a model.
        """
        settings = self.complete(given)
        try:
            return self.builder(model, **arguments_of(self.builder, settings)), settings
        except RangeError as error:
            raise SettingError(error.setting, error.value, f"expected {error.expected}") from error
        except ValueError as error:
            raise InputError(str(error), field=f"the {self.kind} {self.name}") from error

    def check(self, given: Mapping[str, Any]) -> None:
        """Refuse settings before there is a model; errors as in :meth:`build`."""
        if given:
            self.build(_smallest_model(), given)


class Algorithms(Mapping[str, Algorithm]):
    """The algorithms that a package exports."""

    def __init__(self, kind: str, package: str) -> None:
        self.kind, self._package = kind, package

    def __iter__(self) -> Iterator[str]:
        end, loaded = f"_{self.kind}", sys.modules.get(self._package)
        exported = names_declared(self._package) if loaded is None else vars(loaded)
        return (name.removesuffix(end).replace("_", "-") for name in sorted(exported) if name.endswith(end))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __getitem__(self, name: str) -> Algorithm:
        return self._algorithm(name, partial(getattr, import_module(self._package)))

    def described(self, name: str) -> Algorithm:
        """An algorithm whose summary and settings are known, but which cannot be built: nothing is imported for it.

        Raises:
            InputError: There is none of this name.
        """
        if self._package in sys.modules:
            return self[name]
        return self._algorithm(name, partial(declared, self._package))

    def _algorithm(self, name: str, builder: Callable[[str], Any]) -> Algorithm:
        if name not in list(iter(self)):
            likely = ", ".join(get_close_matches(name, list(self)) or self)
            raise InputError(f"{brief(name)} is no {self.kind}", expected=likely)
        return Algorithm(self.kind, name, builder(f"{name.replace('-', '_')}_{self.kind}"))


FILTERS = Algorithms("filter", "poseppl.filters")
SMOOTHERS = Algorithms("smoother", "poseppl.smoothers")


@cache
def _smallest_model() -> CompiledModel:
    """One Gaussian coordinate, seen with Gaussian noise."""
    import numpyro
    import numpyro.distributions as dist

    from poseppl.program import StateSpaceModel

    def state(params: Any, *before: Any) -> None:
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def observation(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("z", dist.Normal(state["x"], 1.0))

    return StateSpaceModel(state, state, observation).compile()
