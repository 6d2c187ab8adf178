"""Kinematic trees as data: joints with parents, offsets and rotation axes, and the markers that ride on them.

A state vector holds the root's position (3, mm) and then the angles (radians) of every joint in the order of declaration, each
joint's in the order of its axes. A point of a joint's frame maps to its parent's by ``X_p = offset + R X_c`` where ``R``
composes the rotations about the joint's axes, leftmost first (``"ZYX"`` is Eq. 19 of Choo and Fleet 2001).

>>> tree = kinematic_tree(
...     [Joint("upper", None, (0, 0, 0), "ZYX"), Joint("lower", "upper", (0, 0, -300), "X")],
...     [Marker("wrist", "lower", (0, 0, -250))],
... )
>>> tree.dimension, tree.coordinates[-1]
(7, ('lower', 'X'))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike


class Joint(NamedTuple):
    """One joint: its name, its parent's name (None for the root), its offset in the parent's frame (mm) and its axes."""

    name: str
    parent: str | None
    offset: tuple[float, float, float]
    axes: str = "ZYX"


class Marker(NamedTuple):
    """A point fixed to a joint's frame, at an offset in mm."""

    name: str
    joint: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class KinematicTree:
    """A kinematic tree, laid out for evaluation: links sorted by depth, each with at most one rotation about Z, Y and X.

    A joint whose axes are not in the order Z, Y, X is split into several links at the same place. ``offsets`` (links, 3) and
    ``marker_offsets`` (markers, 3) are arrays, in mm, that may be traced (to learn limb lengths); everything else is static.
    """

    offsets: Array
    marker_offsets: Array
    joint_names: tuple[str, ...]
    marker_names: tuple[str, ...]
    coordinates: tuple[tuple[str, str], ...]
    link_joint: tuple[int, ...]
    parents: tuple[int, ...]
    depths: tuple[int, ...]
    angle_index: tuple[tuple[int, int, int], ...]
    marker_link: tuple[int, ...]
    offset_pattern: tuple[tuple[bool, bool, bool], ...]
    marker_pattern: tuple[tuple[bool, bool, bool], ...]

    @property
    def dimension(self) -> int:
        """Length of the state vector: three translations and all angles."""
        return len(self.coordinates)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names such as ``knee_r.X`` in the order of the state vector."""
        return tuple(f"{joint}.{axis}" for joint, axis in self.coordinates)

    @property
    def last_links(self) -> dict[str, int]:
        """The link that each joint's own frame is, after all of its turns."""
        return {self.joint_names[joint]: link for link, joint in enumerate(self.link_joint)}

    @property
    def ancestors(self) -> np.ndarray:
        """Which links lie on the path from the root to each link, itself included: 0/1, shape (links, links)."""
        table = np.eye(len(self.parents))
        for link, parent in enumerate(self.parents):
            if parent >= 0:
                table[link] += table[parent]
        return table

    def with_offsets(self, offsets: Array, marker_offsets: Array) -> KinematicTree:
        """Return the same tree with other limb lengths (arrays of the same shapes, zeros where the pattern has none)."""
        return replace(self, offsets=offsets, marker_offsets=marker_offsets)

    def with_markers(self, names: Sequence[str]) -> KinematicTree:
        """Return the same tree with some of its markers alone."""
        chosen = [self.marker_names.index(name) for name in names]
        links, patterns = (tuple(known[index] for index in chosen) for known in (self.marker_link, self.marker_pattern))
        rows = self.marker_offsets[jnp.asarray(chosen)]
        return replace(self, marker_offsets=rows, marker_names=tuple(names), marker_link=links, marker_pattern=patterns)  # type: ignore[arg-type]

    def with_pattern_of(self, other: KinematicTree) -> KinematicTree:
        """Return the same tree, which knows only those offsets to be zero that another one knows.

        Trees of one pattern share compiled programs, whatever their lengths.
        """
        return replace(self, offset_pattern=other.offset_pattern, marker_pattern=other.marker_pattern)

    def with_markers_at(self, places: ArrayLike) -> KinematicTree:
        """Return the same tree with its markers at places (K, 3), mm, of their joints' frames, none known to be on an axis.

        All such trees of the same joints share compiled programs.
        """
        anywhere = ((True,) * 3,) * len(self.marker_names)
        return replace(self, marker_offsets=jnp.asarray(places, float), marker_pattern=anywhere)


_ARRAYS = ["offsets", "marker_offsets"]
jax.tree_util.register_dataclass(
    KinematicTree, _ARRAYS, [field.name for field in fields(KinematicTree) if field.name not in _ARRAYS]
)


def kinematic_tree(joints: Sequence[Joint], markers: Sequence[Marker]) -> KinematicTree:
    """Lay out a kinematic tree.

    Args:
        joints: Parents before children; exactly one root, first.
        markers: At least one.

    Returns:
        The tree, its links sorted by depth.

    Raises:
        ValueError: Duplicate names, an unknown parent or joint, axes other than X, Y and Z, or no marker.
    """
    _check(joints, markers)
    links, coordinates, last_link = _split(joints)
    order = sorted(range(len(links)), key=lambda i: links[i].depth)
    rank = {old: new for new, old in enumerate(order)}
    ordered = [links[i] for i in order]
    marker_offsets = np.array([marker.offset for marker in markers], float)
    offsets = np.array([link.offset for link in ordered], float)
    names = tuple(joint.name for joint in joints)
    return KinematicTree(
        offsets=jnp.asarray(offsets, float),
        marker_offsets=jnp.asarray(marker_offsets, float),
        joint_names=names,
        marker_names=tuple(marker.name for marker in markers),
        coordinates=tuple(coordinates),
        link_joint=tuple(link.joint for link in ordered),
        parents=tuple(rank[link.parent] if link.parent >= 0 else -1 for link in ordered),
        depths=tuple(link.depth for link in ordered),
        angle_index=tuple(link.angles for link in ordered),
        marker_link=tuple(rank[last_link[marker.joint]] for marker in markers),
        offset_pattern=_pattern(offsets),
        marker_pattern=_pattern(marker_offsets),
    )


class _Link(NamedTuple):
    joint: int
    parent: int
    depth: int
    offset: tuple[float, float, float]
    angles: tuple[int, int, int]


def _split(joints: Sequence[Joint]) -> tuple[list[_Link], list[tuple[str, str]], dict[str, int]]:
    """Turn joints into links of rotations in the order Z, Y, X, and number the coordinates."""
    links: list[_Link] = []
    last_link: dict[str, int] = {}
    coordinates = [(joints[0].name, axis) for axis in ("tx", "ty", "tz")]
    for index, joint in enumerate(joints):
        parent = -1 if joint.parent is None else last_link[joint.parent]
        offset = tuple(float(value) for value in joint.offset)
        for run in _runs(joint.axes):
            angles = [-1, -1, -1]
            for axis in run:
                angles["ZYX".index(axis)] = len(coordinates)
                coordinates.append((joint.name, axis))
            depth = 0 if parent < 0 else links[parent].depth + 1
            links.append(_Link(index, parent, depth, offset, tuple(angles)))  # type: ignore[arg-type]
            parent, offset = len(links) - 1, (0.0, 0.0, 0.0)
        last_link[joint.name] = parent
    return links, coordinates, last_link


def _runs(axes: str) -> list[str]:
    """Split a sequence of axes into the longest runs in the order Z, Y, X: "XYZ" -> X, Y, Z; "ZXY" -> ZX, Y."""
    runs = [""]
    for axis in axes:
        if runs[-1] and "ZYX".index(axis) <= "ZYX".index(runs[-1][-1]):
            runs.append("")
        runs[-1] += axis
    return runs


def _pattern(offsets: np.ndarray) -> tuple[tuple[bool, bool, bool], ...]:
    return tuple(tuple(bool(value) for value in row) for row in offsets != 0)  # type: ignore[misc]


def _check(joints: Sequence[Joint], markers: Sequence[Marker]) -> None:
    if not joints or joints[0].parent is not None:
        raise ValueError("the first joint must be the root: give it parent=None")
    if any(value != 0 for value in joints[0].offset):
        raise ValueError(f"the root {joints[0].name!r} has an offset: its place is its translation, so make the offset 0")
    if not markers:
        raise ValueError("a kinematic tree needs at least one marker")
    known: set[str] = set()
    for joint in joints:
        if joint.name in known:
            raise ValueError(f"two joints are named {joint.name!r}")
        if known and joint.parent not in known:
            raise ValueError(
                f"joint {joint.name!r} names parent {joint.parent!r}; expected one of {sorted(known)}, declared before it"
            )
        if set(joint.axes) - set("XYZ"):
            raise ValueError(f"joint {joint.name!r} has axes {joint.axes!r}; expected letters of 'XYZ'")
        known.add(joint.name)
    names = [marker.name for marker in markers]
    for marker in markers:
        if marker.joint not in known:
            raise ValueError(f"marker {marker.name!r} rides on joint {marker.joint!r}; expected one of {sorted(known)}")
        if names.count(marker.name) > 1:
            raise ValueError(f"two markers are named {marker.name!r}")
