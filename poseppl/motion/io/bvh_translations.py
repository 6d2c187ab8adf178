"""BVH recordings whose joints have position channels of their own, as studios export them: bones that stretch or slide.

A joint's position channels stand in the place of its OFFSET, in the parent's axes. pybvh reads rotations of joints alone, so
the channels are taken out of the text, the OFFSET becomes their median, and the places are computed here:

    p_child = p_parent + R_parent t_child,    R_child = R_parent Q_child,    Q = the product of the rotations as listed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.motion import joint_positions


class Split(NamedTuple):
    """A BVH text without the joints' own positions, and these (T, 3) in the file's unit by the joint's name."""

    text: str
    translations: Mapping[str, Floats]


def split_translations(path: FilePath, text: str) -> Split:
    """Take the position channels of joints other than the root out of a text.

    Args:
        path: The file, for messages.
        text: A recording whose hierarchy and numbers were checked.

    Returns:
        The text that is left, the same one where no joint has positions of its own.

    Raises:
        InputError: A joint has one or two position channels.
    """
    lines = text.split("\n")
    motion = next(number for number, line in enumerate(lines) if line.split()[:1] == ["MOTION"])
    taken: dict[str, tuple[int, dict[str, int]]] = {}
    kept: list[int] = []
    kind, name, offset, column = "", "", 0, 0
    for number, line in enumerate(lines[:motion]):
        words = line.split()
        if words[:1] in (["ROOT"], ["JOINT"]):
            kind, name = words
        elif words[:1] == ["OFFSET"]:
            offset = number
        elif words[:1] == ["CHANNELS"]:
            mine = {word: column + index for index, word in enumerate(words[2:])}
            moved = {word[0].upper(): at for word, at in mine.items() if word.lower().endswith("position")}
            if kind == "JOINT" and moved:
                if set(moved) != set("XYZ"):
                    problem = f"position channels {', '.join(sorted(moved))} of {name!r}"
                    raise Location(path, number + 1, "CHANNELS").error(problem, "X, Y and Z, or none")
                taken[name] = offset, moved
                mine = {word: at for word, at in mine.items() if at not in moved.values()}
                lines[number] = f"CHANNELS {len(mine)} {' '.join(mine)}"
            kept += mine.values()
            column += len(words) - 2
    if not taken:
        return Split(text, {})
    rows = [(number, line.split()) for number, line in enumerate(lines) if number > motion and line.split()][2:]
    translations: dict[str, Floats] = {}
    for name, (offset, moved) in taken.items():
        values = np.array([[float(words[moved[axis]]) for axis in "XYZ"] for _, words in rows])
        translations[name] = values
        lines[offset] = "OFFSET " + " ".join(repr(float(value)) for value in np.median(values, axis=0))
    for number, words in rows:
        lines[number] = " ".join(words[index] for index in kept)
    return Split("\n".join(lines), translations)


def place_nodes(clip: Any, translations: Mapping[str, Floats]) -> Floats:
    """Places (T, J, 3) of the nodes of pybvh's clip, in its order, in the file's unit.

    Args:
        clip: What pybvh read.
        translations: Of some joints, (T, 3) each; the others keep their offset.
    """
    angles = {name: np.asarray(clip.joint_angles[:, index]) for index, name in enumerate(clip.joint_names)}
    index = {id(node): number for number, node in enumerate(clip.nodes)}
    root = np.asarray(clip.node_positions(), np.float64)[:, 0]
    turns = [
        Rotation.identity(len(root))
        if node.is_end_site()
        else Rotation.from_euler("".join(node.rot_channels).upper(), angles[node.name])
        for node in clip.nodes
    ]
    parents = [-1 if node.parent is None else index[id(node.parent)] for node in clip.nodes]
    return joint_positions(parents, [translations.get(node.name, node.offset) for node in clip.nodes], turns, root)
