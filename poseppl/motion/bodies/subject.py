"""A recorded person as a body: which joints are which markers, how long the limbs are, and the state at every frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError, Phrase, brief
from poseppl.motion.bodies.body import Body
from poseppl.motion.bodies.inverse_kinematics import fit_states
from poseppl.motion.io.motion import Motion
from poseppl.motion.io.names import folded, without_namespace, without_prefixes
from poseppl.motion.io.text_parsing import some


class MovingSubject(NamedTuple):
    """A body in motion.

    Attributes:
        body: The body, with the subject's limb lengths.
        states: (T, d) true states; of a recording those that come closest to it.
        markers: (T, K, 3) mm, true places of the markers; NaN where unknown.
        residual: Mean distance in mm between the markers and those of the states; None where the states are exact.
        frames: (T,) frame numbers.
        rate: Frames a second.
        source: Source.
        notes: Notes of the recording's reader, a sentence each.
    """

    body: Body
    states: Floats
    markers: Floats
    residual: float | None
    frames: Integers
    rate: float
    source: str
    notes: tuple[str, ...] = ()

    def complete_markers(self) -> Floats:
        """The markers, those of the states where their own places are unknown."""
        return np.where(np.isfinite(self.markers), self.markers, self.body.places(self.states))


def match_markers(
    motion: Motion,
    names: tuple[str, ...],
    aliases: Mapping[str, tuple[str, ...]],
    given: Mapping[str, tuple[str, ...]] | None = None,
) -> Floats:
    """Find a body's markers among the points of a recording.

    Args:
        motion: T frames.
        names: The K markers.
        aliases: For each marker the names that recordings use, the most fitting first; ``A+B`` is the mean of points A and B,
            missing where one of them is. If a recording has no name of a marker exactly, names are compared without prefixes,
            case and punctuation (:mod:`poseppl.motion.io.names`). One point is one marker, the first that it fits.
        given: For some markers the points whose mean they are, in place of the aliases.

    Returns:
        Places (T, K, 3) in mm, NaN for a marker that the recording lacks.

    Raises:
        InputError: The recording has none of the names, or lacks a point that is given.
    """
    found: dict[str, list[str]] = {}
    for marker, points in (given or {}).items():
        if marker not in names:
            raise InputError(
                f"the body has no marker {brief(marker)}", field=Argument("names"), expected="one of " + some(names, 20)
            )
        found[marker] = [motion.names[motion.index(point)] for point in points]
    for marker in names:
        if marker not in found:
            taken = {points[0] for points in found.values() if len(points) == 1}
            found[marker] = _first_alias(aliases.get(marker, ()), motion.names, taken)
    if not any(found.values()):
        raise InputError(
            f"none of its {len(motion.names)} points ({some(motion.names)}) is a joint of the body",
            file=motion.source,
            expected=Phrase(
                f"joint centres such as {some([aliases[name][0] for name in names if aliases.get(name)])}; or ",
                Argument("names", "TABLE.toml"),
            ),
        )
    missing = np.full(motion.positions[:, 0].shape, np.nan)
    return np.stack([_mean_point(motion, found[marker]) if found[marker] else missing for marker in names], axis=1)


def _first_alias(aliases: tuple[str, ...], names: tuple[str, ...], taken: set[str]) -> list[str]:
    """The points of the first alias that a recording has: exactly, or else folded, with or without a common prefix."""
    tables: list[tuple[dict[str, str], Callable[[str], str]]] = [({name: name for name in names}, str)]
    for bare in (map(without_namespace, names), without_prefixes(names)):
        plain = [folded(name) for name in bare]
        tables.append(({own: name for own, name in zip(plain, names, strict=True) if plain.count(own) == 1}, folded))
    for known, form in tables:
        for alias in aliases:
            points = [known[form(part)] for part in alias.split("+") if form(part) in known]
            if len(points) == alias.count("+") + 1 and not (len(points) == 1 and points[0] in taken):
                return points
    return []


def _mean_point(motion: Motion, names: list[str]) -> Floats:
    mean: Floats = np.mean([motion.positions[:, motion.index(name)] for name in names], axis=0)
    return mean


def fit_subject(
    motion: Motion,
    build: Callable[..., Body],
    lengths: Mapping[str, float] | None = None,
    given: Mapping[str, tuple[str, ...]] | None = None,
) -> MovingSubject:
    """Measure the limbs of a recorded person and fit the body to every frame.

    Args:
        motion: The recording, Z up.
        build: Builds the body from limb lengths.
        lengths: Limb lengths in mm that are known; the others are measured.
        given: Points of some markers, as :func:`match_markers` takes them.

    Raises:
        InputError: The recording lacks the joints that the body cannot do without.
    """
    standard = build(None)
    names = standard.tree.marker_names
    markers = match_markers(motion, names, standard.aliases, given)
    try:
        measured = standard.measure({name: markers[:, i] for i, name in enumerate(names)})
    except ValueError as error:
        raise InputError(
            f"its points ({some(motion.names)}) are too few for the body: {error}",
            file=motion.source,
            expected=Phrase(f"points for {some(_absent(names, markers))}; name them with ", Argument("names", "TABLE.toml")),
        ) from error
    body = build({**measured, **(lengths or {})})
    states, residual = fit_states(body.tree, markers, body.rest)
    mean = float(np.nanmean(residual))
    return MovingSubject(body, states, markers, mean, np.arange(len(states)), motion.rate, motion.source, motion.notes)


def _absent(names: tuple[str, ...], markers: NDArray[Any]) -> list[str]:
    return [name for name, seen in zip(names, np.isfinite(markers).all(-1).any(0), strict=True) if not seen]
