"""Builders that build once: the same filter, smoother or collector for the same model and equal settings.

JAX compiles a function again whenever it is another object, even if it does the same. A builder decorated with
:func:`memoized_builder` returns for equal settings the very object that it returned before, so that what was compiled for it
serves again. The result is kept on the builder's first argument (a model, a filter, a smoother), and dies with it.

>>> class Model:
...     '''Anything that can have attributes.'''
>>> @memoized_builder
... def squarer(model, power=2):
...     return lambda x: x**power
>>> model = Model()
>>> squarer(model) is squarer(model, power=2), squarer(model) is squarer(model, 3), squarer(model) is squarer(Model())
(True, False, False)
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from typing import Any, ParamSpec, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

P = ParamSpec("P")
R = TypeVar("R")

_MAX = 16
"""Results of a builder that its first argument keeps; beyond, the one that was not asked for longest goes."""
_CACHE_ATTR = "_built"
_surely_outside: Any = None
"""Tells at once that nothing is being transformed; where JAX has no such function, an array is made to see."""
with suppress(ImportError):
    _surely_outside = getattr(import_module("jax._src.core"), "trace_state_clean", None)


def memoized_builder(build: Callable[P, R]) -> Callable[P, R]:
    """Let a builder return what it built before for the same first argument and equal settings.

    Settings are equal if they are of the same types and values; arrays count by their contents, functions by identity. Builds
    while JAX traces, and those with a setting that cannot be compared, are kept nowhere. A result with a field ``model`` that
    is None gets the first argument as its model.
    """
    signature = inspect.signature(build)

    @functools.wraps(build)
    def builder(*args: P.args, **kwargs: P.kwargs) -> R:
        given = signature.bind(*args, **kwargs)
        given.apply_defaults()
        owner, *settings = given.arguments.values()
        shelves = getattr(owner, "__dict__", None)
        key = None if shelves is None or _is_tracing() else _key(settings)
        if shelves is None or key is None:
            return cast(R, _with_model(build(*args, **kwargs), owner))
        shelf = shelves.setdefault(_CACHE_ATTR, {}).setdefault(build, OrderedDict())
        if key not in shelf:
            shelf[key] = _with_model(build(*args, **kwargs), owner)
            if len(shelf) > _MAX:
                shelf.popitem(last=False)
        shelf.move_to_end(key)
        return cast(R, shelf[key])

    return builder


def _is_tracing() -> bool:
    """Whether arrays made now would belong to a trace."""
    if _surely_outside is not None and _surely_outside():
        return False
    return isinstance(jax.device_put(np.zeros(())), jax.core.Tracer)  # which compiles nothing


def _with_model(result: Any, owner: Any) -> Any:
    nameless = hasattr(owner, "programs") and getattr(result, "model", owner) is None  # of a compiled model
    return dataclasses.replace(result, model=owner) if nameless else result


def _key(settings: list[Any]) -> Any | None:
    """Something hashable that is equal for equal settings; None if there is none."""
    try:
        key = jnp.result_type(float), tuple(_comparable(setting) for setting in settings)
        hash(key)
    except TypeError:
        return None
    return key


def _comparable(value: Any) -> Any:
    kind = type(value)
    if isinstance(value, jax.core.Tracer):
        raise TypeError("the value of a tracer is not known")
    if isinstance(value, np.ndarray | Array):
        array = np.asarray(value)
        return kind, array.dtype.str, array.shape, array.tobytes()
    if isinstance(value, Mapping):
        return kind, tuple((name, _comparable(part)) for name, part in value.items())
    if isinstance(value, list | tuple):
        return kind, tuple(_comparable(part) for part in value)
    return kind, value
