"""Pickles of plain values: numbers, texts, bytes, lists, tuples, dicts, and arrays of numbers. Nothing of a pickle is run.

A pickle is a program that may call anything. So its operations are read first, and refused unless each is one of those that
plain values need. Names of functions are compared with the few that pickled NumPy arrays use. They are replaced by functions of
this module, which check their arguments: the array's kind, shape and bytes have to agree. No name is imported.

A small pickle may contain one value many times, and so become huge when it is hashed, copied or written out. Keys of a dict are
therefore texts and numbers alone, and arrays together have no more bytes than the pickle could bring along.

>>> import pickle
>>> plain_of_pickle(pickle.dumps({"size": [2, 3]}), Location("size.pickle"))
{'size': [2, 3]}
>>> plain_of_pickle(pickle.dumps(print), Location("print.pickle"))
Traceback (most recent call last):
poseppl.errors.InputError: print.pickle: the pickle asks for builtins.print (expected numbers, texts, lists, dicts and arrays)
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
import re
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from poseppl.errors import InputError, Location, brief, cut

MAX_OPERATIONS = 400_000
MAX_VALUES = 400_000
MAX_DIMENSIONS = 8
_EXPECTED = "numbers, texts, lists, dicts and arrays"
_OPERATIONS = frozenset(
    re.findall(
        "[A-Z0-9_]+",
        """
        PROTO FRAME STOP MARK POP POP_MARK DUP NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG LONG1 FLOAT BINFLOAT
        STRING BINSTRING SHORT_BINSTRING BINBYTES SHORT_BINBYTES BINBYTES8 BYTEARRAY8 UNICODE BINUNICODE SHORT_BINUNICODE
        BINUNICODE8 EMPTY_LIST LIST APPEND APPENDS EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 EMPTY_DICT DICT SETITEM SETITEMS
        GET BINGET LONG_BINGET PUT BINPUT LONG_BINPUT MEMOIZE GLOBAL STACK_GLOBAL REDUCE BUILD
        """,
    )
)
_PurePython: Any = pickle._Unpickler
"""Its table of operations may be changed, unlike that of the unpickler in C; type checkers do not know it."""
_PUTS = frozenset(("PUT", "BINPUT", "LONG_BINPUT"))
_KIND = re.compile("[<>=|]?[fiub][1248]", re.ASCII)


class _Kind:
    """A kind of numbers, as NumPy names it."""

    def __init__(self, name: Any = "", *_: Any) -> None:
        name = name.decode("latin-1") if isinstance(name, bytes) else name
        if not isinstance(name, str) or not _KIND.fullmatch(name):
            raise ValueError(f"an array of {brief(name)}")
        self.name = name.lstrip("<>=|")
        self.order = "<"

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) < 2 or state[1] not in ("<", ">", "|", "="):
            raise ValueError("an array's kind")
        self.order = "<" if state[1] in "|=" else state[1]

    def array(self, data: Any, shape: Any, fortran: Any) -> Any:
        """The array of these bytes."""
        data = data.encode("latin-1") if isinstance(data, str) else data
        if not isinstance(data, bytes | bytearray) or not isinstance(shape, tuple) or len(shape) > MAX_DIMENSIONS:
            raise ValueError("an array that is none")
        if not all(type(extent) is int and extent >= 0 for extent in shape):
            raise ValueError("an array's shape")
        kind = np.dtype(self.order + self.name)
        if math.prod(shape) * kind.itemsize != len(data):
            raise ValueError(f"an array of shape {brief(shape)} in {len(data)} bytes")
        return np.frombuffer(bytes(data), kind).reshape(shape, order="F" if fortran else "C").astype(kind.newbyteorder("="))


class _Array:
    """An array that is being made."""

    value: Any = None
    nbytes = 0

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) != 5 or not isinstance(state[2], _Kind):
            raise ValueError("an array's state")
        self.value = state[2].array(state[4], state[1], state[3])
        self.nbytes = self.value.nbytes


class _Name:
    """An object that a name stands for. A pickle may call it, and set nothing."""

    def __init__(self, called: Callable[..., Any] | None = None) -> None:
        self._called = called

    def __call__(self, *values: Any) -> Any:
        if self._called is None:
            raise ValueError("a type that is made into nothing")
        return self._called(*values)

    def __setstate__(self, state: Any) -> None:
        raise ValueError("a state for a name")


def _scalar(kind: Any, data: Any) -> Any:
    if not isinstance(kind, _Kind):
        raise ValueError("a number that is none")
    return kind.array(data, (), False).item()


def _from_buffer(data: Any, kind: Any, shape: Any, order: Any = "C", *_: Any) -> Any:
    if not isinstance(kind, _Kind):
        raise ValueError("an array that is none")
    return kind.array(data, shape, order == "F")


def _encode(text: Any, encoding: Any = None) -> bytes:
    """The form of bytes in pickles of Python 2."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
        raise ValueError("bytes that are none")
    return text.encode("latin-1")


def _no_bytes() -> bytes:
    return b""


_NAMES = {
    ("numpy", "ndarray"): _Name(),
    ("numpy", "dtype"): _Name(_Kind),
    ("_codecs", "encode"): _Name(_encode),
    ("__builtin__", "bytes"): _Name(_no_bytes),
}
for _package in ("numpy.core", "numpy._core"):
    _NAMES[f"{_package}.multiarray", "_reconstruct"] = _Name(lambda *_: _Array())
    _NAMES[f"{_package}.multiarray", "scalar"] = _Name(_scalar)
    _NAMES[f"{_package}.numeric", "_frombuffer"] = _Name(_from_buffer)


class _Unpickler(_PurePython):  # type: ignore[misc]
    """An unpickler that imports nothing, hashes no more than texts and numbers, and makes no more bytes than it was given."""

    def __init__(self, data: bytes) -> None:
        super().__init__(io.BytesIO(data), encoding="latin1")
        self._bytes_left = 4 * len(data)

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise pickle.UnpicklingError(f"the pickle asks for {cut(module, 60)}.{cut(name, 60)}")
        return _NAMES[module, name]

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("the pickle refers to another file")

    def _load_items(self) -> None:
        """The values since the mark are keys and values in turn."""
        items = self.pop_mark()
        _set_items(self.stack[-1], items)

    def _load_item(self) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        _set_items(self.stack[-1], [key, value])

    def _load_dict(self) -> None:
        items = self.pop_mark()
        self.append(_set_items({}, items))

    def _load_reduce(self) -> None:
        super().load_reduce()
        self._count_bytes()

    def _load_build(self) -> None:
        super().load_build()
        self._count_bytes()

    def _count_bytes(self) -> None:
        made = self.stack[-1]
        self._bytes_left -= len(made) if isinstance(made, bytes) else getattr(made, "nbytes", 0)
        if self._bytes_left < 0:
            raise pickle.UnpicklingError("the pickle makes more bytes than it has")

    dispatch: ClassVar[dict[int, Callable[..., Any]]] = {
        **_PurePython.dispatch,
        pickle.SETITEM[0]: _load_item,
        pickle.SETITEMS[0]: _load_items,
        pickle.DICT[0]: _load_dict,
        pickle.REDUCE[0]: _load_reduce,
        pickle.BUILD[0]: _load_build,
    }


def _set_items(table: Any, items: list[Any]) -> Any:
    """Set keys and values, in turn, of a dict."""
    keys, values = items[::2], items[1::2]
    if type(table) is not dict or not all(isinstance(key, str | bytes | int | float | None) for key in keys):
        raise pickle.UnpicklingError("the pickle has a key that is no text or number")
    table.update(zip(keys, values, strict=True))
    return table


def plain_of_pickle(data: bytes, at: Location) -> Any:
    """The plain value of a pickle.

    Args:
        data: The pickle; the caller bounds its size.
        at: Its place, for messages.

    Raises:
        InputError: It is no pickle, is damaged, or asks for anything but plain values.
    """
    try:
        _check_operations(data)
        value = _Unpickler(data).load()
        left = [MAX_VALUES]
        return _plain(value, left, 0)
    except InputError:
        raise
    except pickle.UnpicklingError as error:
        problem = str(error)
        raise at.error(problem if problem.startswith("the pickle") else "a damaged pickle", _EXPECTED) from error
    except Exception as error:  # damaged bytes bring about anything
        raise at.error(f"a damaged pickle, or one of something else: {cut(error, 120)}", _EXPECTED) from error


def _check_operations(data: bytes) -> None:
    for number, (operation, argument, _) in enumerate(pickletools.genops(data)):
        if operation.name not in _OPERATIONS:
            raise pickle.UnpicklingError(f"the pickle contains an object that is not a plain value ({operation.name})")
        # The table of what was put aside is as long as the largest number in it.
        if number >= MAX_OPERATIONS or (operation.name in _PUTS and int(argument or 0) > number):
            raise pickle.UnpicklingError("the pickle is too long")


def _plain(value: Any, left: list[int], depth: int) -> Any:
    left[0] -= 1
    if left[0] < 0 or depth > 20:
        raise pickle.UnpicklingError("the pickle contains too many values")
    make: Callable[[Any], Any] = lambda inner: _plain(inner, left, depth + 1)  # noqa: E731
    if isinstance(value, dict):
        return {key: make(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return type(value)([make(inner) for inner in value])
    if isinstance(value, _Array):
        return value.value
    if isinstance(value, np.ndarray | str | bytes | bytearray | int | float | bool | None):
        return value
    raise pickle.UnpicklingError(f"the pickle contains a {type(value).__name__}")
