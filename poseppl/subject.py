"""A recorded person as a body: which joints are which markers, how long the limbs are, and the state at every frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.body import Body
from poseppl.errors import InputError
from poseppl.inverse_kinematics import fit_states
from poseppl.io.motion import Motion


class Subject(NamedTuple):
    """A body with a recorded person's limb lengths, and how well it can follow the recording.

    Attributes:
        body: The body.
        states: (T, d) the states that come closest to the recording.
        markers: (T, K, 3) mm, the recorded places of the body's markers; NaN where missing.
        residual: (T, K) mm, distances between the markers of the states and the recorded ones.
    """

    body: Body
    states: NDArray[np.float64]
    markers: NDArray[np.float64]
    residual: NDArray[np.float64]


def match_markers(motion: Motion, names: tuple[str, ...], aliases: Mapping[str, tuple[str, ...]]) -> NDArray[np.float64]:
    """Find a body's markers among the points of a recording.

    Args:
        motion: T frames.
        names: The K markers.
        aliases: For each marker the names that recordings use, the most fitting first; ``A+B`` is the mean of points A and B,
            missing where one of them is.

    Returns:
        Places (T, K, 3) in mm, NaN for a marker that the recording lacks.

    Raises:
        InputError: The recording has none of the names.
    """
    known = set(motion.names)
    found = {name: next((alias for alias in aliases.get(name, ()) if known >= set(alias.split("+"))), None) for name in names}
    if not any(found.values()):
        raise InputError(
            f"none of its {len(motion.names)} points ({_some(motion.names)}) is a joint of the body",
            file=motion.source,
            expected="joint centres such as " + _some([aliases[name][0] for name in names if aliases.get(name)]),
        )
    missing = np.full(motion.positions[:, 0].shape, np.nan)
    return np.stack([missing if alias is None else _mean_point(motion, alias.split("+")) for alias in found.values()], axis=1)


def _mean_point(motion: Motion, names: list[str]) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = np.mean([motion.positions[:, motion.index(name)] for name in names], axis=0)
    return mean


def fit_subject(motion: Motion, build: Callable[..., Body], lengths: Mapping[str, float] | None = None) -> Subject:
    """Measure the limbs of a recorded person and fit the body to every frame.

    Args:
        motion: The recording, Z up.
        build: Builds the body from limb lengths.
        lengths: Limb lengths in mm that are known; the others are measured.

    Raises:
        InputError: The recording lacks the joints that the body cannot do without.
    """
    standard = build(None)
    names = standard.tree.marker_names
    markers = match_markers(motion, names, standard.aliases)
    try:
        measured = standard.measure({name: markers[:, i] for i, name in enumerate(names)})
    except ValueError as error:
        raise InputError(
            f"its points ({_some(motion.names)}) are too few for the body: {error}",
            file=motion.source,
            expected="; ".join(f"{name}: {' or '.join(standard.aliases.get(name, ()))}" for name in _absent(names, markers)),
        ) from error
    body = build({**measured, **(lengths or {})})
    states, residual = fit_states(body.tree, markers, body.rest)
    return Subject(body, states, markers, residual)


def _absent(names: tuple[str, ...], markers: NDArray[Any]) -> list[str]:
    return [name for name, seen in zip(names, np.isfinite(markers).all(-1).any(0), strict=True) if not seen]


def _some(names: Any) -> str:
    names = list(names)
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
