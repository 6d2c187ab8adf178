"""Compiled programs that outlive the process: the command line's, so that a second run of a command need not trace.

XLA's own cache saves compilation, and is asked with a lowered program: tracing and lowering take Python a few seconds. Here a
program is found by what it is made of (:mod:`poseppl.content_digest`), and what was compiled is loaded. That is machine code in
a pickle, both of which do what they like. So files count only in a folder that is this user's and nobody else's, and only if
they are so themselves. A file is written whole or not at all, under its checksum. One that is damaged, or of another machine
or version, is made again. In Python nothing is stored.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import secrets
import stat
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from poseppl.compilation import jit, jit_lightly
from poseppl.content_digest import digest, digest_of_code, digest_of_settings

T = TypeVar("T")
MAX_BYTES = 2**29
"""Size of the folder; beyond it, the least recently used programs are removed."""
_SUFFIX = ".program"
_folder: Path | None = None


def store_programs(folder: Path | None) -> None:
    """Store programs in a folder from now on, which is made for this user alone; in none if it is not theirs alone, or None.

    Args:
        folder: The folder; the one around it exists.
    """
    global _folder
    _folder = None
    if folder is not None and hasattr(os, "geteuid"):
        with suppress(OSError):
            folder.mkdir(mode=0o700, exist_ok=True)
            _folder = folder if _is_private(os.lstat(folder), stat.S_ISDIR) else None
    _listen()


@functools.cache
def _listen() -> None:
    jax.monitoring.register_event_listener(_count_hits)


def key_of(data: Any, *parts: Any) -> str | None:
    """Key of a stored program.

    Args:
        data: Arguments that it is compiled for; only structure, shapes and types of arrays count.
        parts: Parts of the program: functions, models, settings.

    Returns:
        The key; None where nothing is stored, content is not known, or the device is not the CPU.
    """
    if _folder is None or len(jax.devices()) > 1 or jax.default_backend() != "cpu":
        return None
    with suppress(Exception):  # of unknown content, or of a version of JAX that has no such settings
        leaves, structure = jax.tree.flatten(data)
        kinds = [(str(kind.dtype), kind.shape, kind.weak_type) for kind in map(jax.typeof, leaves)]
        return digest(digest_of_code(), digest_of_settings(), structure, kinds, parts)
    return None


def recalled(key: str | None, name: str, make: Callable[[], T]) -> T:
    """Get a stored program, or make it now and store it.

    Args:
        key: Key of the program; None stores nothing.
        name: Which program of that key.
        make: Makes a compiled program, or a tree of arrays or shapes.
    """
    if key is None or _folder is None:
        return make()
    path = _folder / f"{digest(key, name)}{_SUFFIX}"
    with suppress(Exception):  # damaged in whatever way
        return _loaded(_content(path))  # type: ignore[no-any-return]
    before = _hits.count
    made = make()
    if _hits.count == before:  # XLA loses functions of what it has loaded when it writes that again
        with suppress(Exception):  # no room, or what XLA cannot write
            _write(path, _dumped(made))
            _make_room(_folder)
    return made


def stored_jit(function: Callable[..., Any], num_static: int = 0, lightly: bool = True) -> Callable[..., Any]:
    """`jit` of a function that no other program calls. Its programs are stored where programs are.

    Args:
        function: The function.
        num_static: How many of its first arguments are static.
        lightly: With :func:`poseppl.compilation.jit_lightly`.
    """
    jitted = (jit_lightly if lightly else jit)(function, static_argnums=tuple(range(num_static)))
    name = getattr(function, "__name__", "")
    made: dict[Any, Any] = {}

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        if _folder is None:
            return jitted(*args)
        static, given = args[:num_static], args[num_static:]
        leaves, structure = jax.tree.flatten(given)
        kind = static, structure, tuple(map(jax.typeof, leaves)), jax.numpy.result_type(float)
        if kind not in made:
            made[kind] = recalled(key_of(given, function, static), name, lambda: jitted.lower(*args).compile())
        return made[kind](*given)

    return call


class _Hits(threading.local):
    """How many programs XLA's cache has had for this thread."""

    count = 0


_hits = _Hits()


def _count_hits(event: str, **_: Any) -> None:
    _hits.count += event == "/jax/compilation_cache/cache_hits"


def _dumped(made: Any) -> bytes:
    from jax.experimental.serialize_executable import serialize

    return pickle.dumps((True, serialize(made)) if isinstance(made, jax.stages.Compiled) else (False, made))


def _loaded(content: bytes) -> Any:
    from jax.experimental.serialize_executable import deserialize_and_load

    is_program, parts = pickle.loads(content)
    if is_program:
        _start_lapack()
    return deserialize_and_load(*parts) if is_program else parts


@functools.cache
def _start_lapack() -> None:
    """Have JAX look up LAPACK's functions, which it does when it lowers a program that calls them, not when it loads one."""
    jit(jax.numpy.linalg.cholesky).lower(np.eye(1))


def _content(path: Path) -> bytes:
    """Content of a private file, if its checksum is right.

    Raises:
        OSError: There is no such file.
        ValueError: It is not private, or damaged.
    """
    with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        if not _is_private(os.fstat(file.fileno()), stat.S_ISREG):
            raise ValueError("not this user's alone")
        checksum, content = file.read(hashlib.sha256().digest_size), file.read()
        os.utime(file.fileno())  # it was used
    if checksum != _checksum(path, content):
        raise ValueError("damaged")
    return content


def _write(path: Path, content: bytes) -> None:
    temporary = path.with_suffix(f".{secrets.token_hex(6)}.tmp")
    try:
        with open(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(_checksum(path, content) + content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _checksum(path: Path, content: bytes) -> bytes:
    """Checksum of the content under its name."""
    return hashlib.sha256(path.name.encode() + content).digest()


def _make_room(folder: Path) -> None:
    """Remove what was not used for longest, until the folder is small enough."""
    files = sorted(((entry.stat(), entry.path) for entry in os.scandir(folder)), key=lambda item: item[0].st_mtime)
    excess = sum(status.st_size for status, _ in files) - MAX_BYTES
    for status, path in files:
        if excess > 0:
            os.unlink(path)
            excess -= status.st_size


def _is_private(status: os.stat_result, of_kind: Callable[[int], bool]) -> bool:
    """Whether something is this user's, and nobody else may read or write it."""
    return of_kind(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o077
