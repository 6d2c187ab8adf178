"""Left and right: names of joints and parts end in ``_l`` or ``_r``, and one side is the other's mirror image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise


def mirrored_angle(angles: Mapping[tuple[str, str], float], joint: str, axis: str) -> float:
    """The angle of a joint about an axis from those of the left side; 0 where none is given."""
    name, _, side = joint.partition("_")
    value = angles.get((name, axis), 0.0)
    return -value if side == "r" and axis in "YZ" else value


def edges_along(trunk: Sequence[str], limbs: Sequence[Sequence[str]]) -> tuple[tuple[str, str], ...]:
    """Pairs of markers that follow each other, along the trunk and along the limbs of both sides, which begin on it."""
    sided = [(start, *(f"{name}_{side}" for name in limb)) for side in "lr" for start, *limb in limbs]
    return tuple(pair for chain in (trunk, *sided) for pair in pairwise(chain))


def neighbours_in(chains: Sequence[Sequence[str]]) -> Callable[[str, str], bool]:
    """Whether two parts meet: each with the next of a chain, on one side or across the middle."""
    neighbours = {frozenset(pair) for chain in chains for pair in pairwise(chain)}

    def meet(first: str, second: str) -> bool:
        (one, side), (other, other_side) = (_split(name) for name in (first, second))
        return frozenset((one, other)) in neighbours and (not side or not other_side or side == other_side)

    return meet


def _split(name: str) -> tuple[str, str]:
    return (name[:-2], name[-1]) if name[-2:] in ("_l", "_r") else (name, "")
