"""A digest of what a compiled program is made of: functions with their closures, settings and arrays, by content.

Values of equal digests trace to the same program, in this process or another, where :func:`digest_of_code` is equal as well. A
function may refer to other names of its module, for which the module's source counts. So only functions and classes of poseppl,
its models and the libraries underneath are known. Everything else, such as a user's model, has no digest.

>>> digest(digest_of_code, {"draws": 3}) == digest(digest_of_code, {"draws": 3}) != digest(digest_of_code, {"draws": 4})
True
"""

from __future__ import annotations

import enum
import functools
import hashlib
import importlib.util
import operator
import os
import platform
import sys
import types
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.extend.core import Primitive

from poseppl.compilation import jit

_OWN = ("poseppl", "poseppl_models")
_LIBRARIES = ("jax", "jaxlib", "numpyro", "blackjax", "optax", "numpy", "scipy")
_WRAPPERS = (type(jit(abs)), type(functools.cache(abs)))
"""Types of functions that are jitted or cached."""
_STANDARD = ("builtins", "collections", "enum", "functools", "inspect", "math", "operator", "typing")
_VALUES = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis), type(NotImplemented), range)
_OF_PYTHON = 1 << 9
"""Flag of classes that Python code has defined: what objects of others hold may be in no attribute."""
_ENVIRONMENT = ("JAX_", "XLA_", "TF_XLA", "POSEPPL_", "NUMPYRO_")
_WITHOUT_EFFECT = ("cache", "log", "debug_log", "traceback", "dump")
"""In names of JAX's settings that change no program."""


class UnknownContent(Exception):
    """A value whose content is not known, such as a function of the user's."""


def digest(*values: Any) -> str:
    """The digest of values, 64 hexadecimal digits.

    Raises:
        UnknownContent: Something in them is no value, and not of poseppl or a library of its.
    """
    walk = _Walk()
    try:
        walk.add(values)
    except RecursionError as error:
        raise UnknownContent("values too deep within each other") from error
    return walk.hash.hexdigest()


@functools.cache
def digest_of_code() -> str:
    """The digest of what is the same for a whole process: sources, versions, machine, and the environment of JAX."""
    known = hashlib.sha256()
    for package in _OWN:
        spec = importlib.util.find_spec(package)
        for folder in sorted(spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                known.update(f"{file.relative_to(folder)}\n".encode() + file.read_bytes())
    known.update(repr([(name, version(name)) for name in _LIBRARIES]).encode())
    known.update(repr((sys.version, platform.platform(), sys.flags.optimize, os.cpu_count(), _processor())).encode())
    known.update(repr(sorted(item for item in os.environ.items() if item[0].startswith(_ENVIRONMENT))).encode())
    return known.hexdigest()


def digest_of_settings() -> str:
    """The digest of JAX's settings now, and of its devices."""
    values = {
        name: str(value) for name, value in jax.config.values.items() if not any(word in name for word in _WITHOUT_EFFECT)
    }
    devices = [(device.platform, device.device_kind, device.client.platform_version) for device in jax.devices()]
    return digest(values, devices, jax.numpy.result_type(float))


def _processor() -> str:
    """Kind and features of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU "))}))


class _Walk:
    """A walk through values, each once."""

    def __init__(self) -> None:
        self.hash = hashlib.sha256()
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []

    def add(self, value: Any) -> None:
        """Add a value."""
        if type(value) in _VALUES or isinstance(value, np.dtype):
            self._write("value", type(value).__name__, repr(value))
            return
        if id(value) in self._seen:
            self._write("again", self._seen[id(value)])
            return
        self._seen[id(value)] = len(self._seen)
        self._alive.append(value)  # its id is another's otherwise
        self._write(type(value).__name__)
        for part in self._parts(value):
            self.add(part)
        self._write("end")

    def _write(self, *words: Any) -> None:
        self.hash.update("\0".join(str(word) for word in words).encode(errors="backslashreplace") + b"\1")

    def _parts(self, value: Any) -> Iterator[Any]:
        """Parts of a value."""
        if isinstance(value, jax.core.Tracer):
            raise UnknownContent("the value of a tracer")
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            yield from _array_parts(value)
        elif isinstance(value, type):
            yield _name_of(value)
        elif isinstance(value, types.ModuleType):
            _check_known(value.__name__)
            yield value.__name__
        elif isinstance(value, types.FunctionType):
            yield from _function_parts(value)
        elif isinstance(value, types.CodeType):
            yield from (value.co_code, value.co_names, value.co_consts, value.co_varnames)
        elif isinstance(value, slice):
            yield from (value.start, value.stop, value.step)
        elif isinstance(value, types.MethodType):
            yield from (value.__func__, value.__self__)
        elif isinstance(value, functools.partial):
            yield from (value.func, value.args, value.keywords)
        elif isinstance(value, types.CellType):
            yield value.cell_contents if _is_filled(value) else "empty"
        elif isinstance(value, Mapping):
            yield from (type(value), *(part for item in value.items() for part in item))
        elif isinstance(value, set | frozenset):
            yield from (type(value), *sorted(digest(part) for part in value))
        elif isinstance(value, tuple | list):
            yield from (type(value), *value)
        elif isinstance(value, enum.Enum):
            yield from (type(value), value.name)
        elif isinstance(value, jax.tree_util.PyTreeDef):
            yield from (value.node_data(), value.children(), value.num_leaves)
        elif isinstance(value, types.BuiltinFunctionType | np.ufunc | Primitive):
            yield _name_of(value)
        elif isinstance(value, _WRAPPERS):
            yield getattr(value, "__wrapped__")  # noqa: B009
        else:
            yield from _object_parts(value)


def _array_parts(value: Any) -> Iterator[Any]:
    if isinstance(value, jax.Array):
        yield from (str(jax.typeof(value)), jax.typeof(value).weak_type)
        if jax.numpy.issubdtype(value.dtype, jax.dtypes.prng_key):
            value = jax.random.key_data(value)
    array = np.asarray(value)
    if array.dtype.hasobject:
        raise UnknownContent("an array of objects")
    yield from (array.dtype.str, array.shape, array.tobytes())


def _function_parts(value: types.FunctionType) -> Iterator[Any]:
    module = value.__globals__.get("__name__", "")
    _check_known(module)
    if getattr(sys.modules.get(module), "__dict__", None) is not value.__globals__:
        raise UnknownContent(f"a function of a second module {module!r}")
    yield from (module, value.__code__, value.__defaults__, value.__kwdefaults__, value.__closure__, value.__dict__)


def _object_parts(value: Any) -> Iterator[Any]:
    """The class and the attributes of an object, without what is computed from them when it is asked for."""
    kind = type(value)
    inherited = [item for each in kind.__mro__ for item in vars(each).items()]
    slots = [what for name, what in inherited if name == "__slots__"]
    in_python = all(each is object or each.__flags__ & _OF_PYTHON for each in kind.__mro__) and "jaxlib" not in kind.__module__
    if not in_python or not (slots or hasattr(value, "__dict__")):
        raise UnknownContent(f"an object of {kind.__module__}.{kind.__qualname__}")
    yield kind
    for names in slots:
        for name in (names,) if isinstance(names, str) else names:
            if name not in ("__weakref__", "__dict__"):
                yield from (name, getattr(value, name, None))
    computed = {name for name, what in inherited if isinstance(what, functools.cached_property)}
    yield from (item for item in getattr(value, "__dict__", {}).items() if item[0] not in computed | {"_built"})


def _name_of(value: Any) -> str:
    """The name of a class, a built-in function or a primitive.

    Our classes must be the ones that their modules have by their names.
    """
    if isinstance(value, Primitive):
        _check_known(type(value).__module__)
        return str(value.name)
    name = getattr(value, "__qualname__", value.__name__)
    module = getattr(value, "__module__", None) or type(value).__module__
    _check_known(module)
    bound = getattr(value, "__self__", None)
    found = sys.modules.get(module)
    with suppress(AttributeError):
        found = operator.attrgetter(name)(found)
    ours = isinstance(value, type) and module.partition(".")[0] in _OWN
    if "<locals>" in name or (ours and found is not value) or not isinstance(bound, types.ModuleType | None):
        raise UnknownContent(f"{name!r} of {module!r}")
    return f"{module}:{name}"


def _check_known(module: str) -> None:
    if module.partition(".")[0] not in (*_OWN, *_LIBRARIES, *_STANDARD):
        raise UnknownContent(f"a function of {module!r}")


def _is_filled(cell: types.CellType) -> bool:
    try:
        cell.cell_contents  # noqa: B018
    except ValueError:
        return False
    return True
