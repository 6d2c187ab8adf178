"""Which outputs of a traced function depend on which of its inputs, read from its jaxpr.

The answer is structural: an output that multiplies an input by zero counts as dependent. Calls (jit, remat, custom
derivatives) are followed inside; loops and branches count as depending on everything that enters them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from jax.extend import core

_CALLS = ("jaxpr", "call_jaxpr", "fun_jaxpr")
_CONTROL_FLOW = ("scan", "while", "cond")


def output_dependence(closed: core.ClosedJaxpr, inputs: Sequence[frozenset[int]]) -> list[frozenset[int]]:
    """Labels that reach each output.

    Args:
        closed: The traced function.
        inputs: For each flat input, the labels that it carries.

    Returns:
        For each flat output, the union of the labels of the inputs that it depends on.
    """
    return _walk(closed.jaxpr, inputs)


def _walk(jaxpr: core.Jaxpr, inputs: Sequence[frozenset[int]]) -> list[frozenset[int]]:
    labels: dict[Any, frozenset[int]] = dict(zip(jaxpr.invars, inputs, strict=True))

    def read(atom: Any) -> frozenset[int]:
        return frozenset() if isinstance(atom, core.Literal) else labels.get(atom, frozenset())

    for equation in jaxpr.eqns:
        entering = [read(atom) for atom in equation.invars]
        inner = _called(equation, len(entering))
        if inner is None:
            union: frozenset[int] = frozenset().union(*entering)
            leaving = [union] * len(equation.outvars)
        else:
            leaving = _walk(inner, entering)
        labels.update(zip(equation.outvars, leaving, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _called(equation: Any, num_inputs: int) -> core.Jaxpr | None:
    if equation.primitive.name in _CONTROL_FLOW:
        return None
    for name in _CALLS:
        inner = equation.params.get(name)
        inner = getattr(inner, "jaxpr", inner)
        if inner is not None and len(inner.invars) == num_inputs and len(inner.outvars) == len(equation.outvars):
            return inner  # type: ignore[no-any-return]
    return None
