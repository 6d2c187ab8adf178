"""Explanation of errors inside a user's program, and in its inputs, in terms of the model."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import jax
import jax.numpy as jnp

_NAMED = 6
"""Arrays whose shapes the message lists."""
_CONFUSED = (TypeError, ValueError, AttributeError, IndexError)
"""Errors of programs that get something else than they expect."""


def suggestion(name: str, candidates: Iterable[str]) -> str:
    """`: did you mean 'x'?` when a candidate is close, else nothing."""
    close = difflib.get_close_matches(name, list(candidates), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


@contextmanager
def explained(which: str, state: Iterable[str], arguments: tuple[Any, ...]) -> Iterator[None]:
    """Say in terms of the model what went wrong inside a program.

    Args:
        which: Name of the program.
        state: Names of the state's sites.
        arguments: The arguments that it got: params, values of the state's sites if it takes them, inputs, ...; or nothing.

    Raises:
        ValueError: Whatever a program raises that was called with something unexpected.
    """
    try:
        yield
    except KeyError as error:
        key = str(error.args[0]) if error.args else ""
        hint = suggestion(key, state)
        raise ValueError(
            f"The {which} program looks up {key!r}, which nothing provides{hint}. State sites: {list(state)}."
        ) from error
    except AssertionError as error:
        if "unique names" not in str(error):
            raise
        raise ValueError(f"The {which} program: {error}. Give every site its own name.") from error
    except _Refused as error:
        raise ValueError(f"The {which} program {error}") from None
    except _CONFUSED as error:
        raise ValueError(f"The {which} program fails: {_first_line(error)}. {_cure(state, arguments)}") from error


class _Refused(Exception):
    """A program does what no state-space model can mean; the message goes on after "The ... program"."""


def refuse(message: str) -> _Refused:
    """An error to raise inside a program; :func:`explained` puts the program's name before it."""
    return _Refused(message)


def _first_line(error: Exception) -> str:
    first = str(error).strip().partition("\n")[0][:300].rstrip(".")
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def _cure(state: Iterable[str], arguments: tuple[Any, ...]) -> str:
    """Advice on what to look at when a program fails."""
    if not arguments:
        return "It gets no arguments."
    params, *rest = arguments
    takes_state = isinstance(rest[0], dict) and list(rest[0]) == list(state)
    inputs = rest[1] if takes_state else rest[0]
    cures = [f"It got the state as a dict of its sites {list(state)}"] if takes_state else []
    if params is None:
        cures.append("It got params = None: where it reads params, give them, compile(params=...)")
    if inputs is None:
        cures.append("It got inputs = None: where it reads inputs, give those of one frame, compile(inputs=...)")
    else:
        cures.append(
            f"It got inputs of shapes {shapes_of(inputs)}: expected those of one frame, without a leading axis of frames "
            "(poseppl.runs.run.frame_inputs(inputs, 0) takes them from a sequence)"
        )
    return ". ".join(cures) + "."


def shapes_of(tree: Any) -> str:
    """Shapes of a tree's leaves, in words."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    named = [(jax.tree_util.keystr(path), _shape(leaf)) for path, leaf in leaves[:_NAMED]]
    parts = [f"{name} {shape}" if name else f"{shape}" for name, shape in named]
    return ", ".join(parts) + (f" and {len(leaves) - _NAMED} more" if len(leaves) > _NAMED else "") if parts else "none"


def _shape(leaf: Any) -> tuple[int, ...]:
    return tuple(leaf.shape) if hasattr(leaf, "shape") else jnp.shape(leaf)


def check_inputs(expected: Any, inputs: Any) -> None:
    """Compare the inputs of a frame with those that the model was compiled for; a model compiled for none takes any.

    Raises:
        ValueError: They are missing, of another structure, or of other shapes.
    """
    wanted, leaves = jax.tree.leaves(expected), jax.tree.leaves(inputs)
    given, tree = jax.tree.structure(inputs), jax.tree.structure(expected)
    same = bool(given == tree)  # type: ignore[operator]
    if not wanted or (same and all(_shape(a) == _shape(b) for a, b in zip(leaves, wanted, strict=True))):
        return
    given_shapes = shapes_of(inputs) if leaves else "missing"
    raise ValueError(
        f"The inputs of a frame are {given_shapes}; the model was compiled for {shapes_of(expected)}. Give every frame's "
        "inputs with a leading axis of T frames, or Constant(...) for what stays; compile() takes those of one frame, "
        "poseppl.runs.run.frame_inputs(inputs, 0)."
    )
