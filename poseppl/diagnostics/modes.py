r"""Modes of each frame's draws: groups with a gap between them, each with its share of the probability.

A group of draws is divided in two at the point of an axis that minimises the variance along it. The axes are each coordinate
and the principal axes of largest variance. Both parts must have at least a twentieth of all draws, and at least ten. Their
distance in units of their own standard deviations,

    D = |m_1 - m_2| / sqrt((v_1 + v_2) / 2)

(Ashman, Bird and Zepf 1994, doi:10.1086/117248), is at least 4: the halves of a normal distribution are 2.65 apart, those of a
uniform one 3.46. Parts are divided again in the same way. Two modes that touch count as one therefore. Positions
in space are taken relative to their centre, and the centre by itself, for a shape is often known better than where it stands.

>>> rng = np.random.default_rng(0)
>>> draws = np.where(rng.uniform(size=500) < 0.3, -3.0, 3.0) + 0.5 * rng.normal(size=500)
>>> np.bincount(mode_labels(draws[:, None])).tolist() == [(draws > 0).sum(), (draws < 0).sum()]
True
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Floats, Integers
from poseppl.diagnostics.selection import Array
from poseppl.runs.contents import draws_of, frame_numbers, names_of

MIN_APART = 4.0
"""D of two modes."""
MIN_SHARE, MIN_DRAWS = 0.05, 10
"""Share of all draws that a mode has at least."""
MAX_MODES = 4
_AXES = 3
_ROUNDING = 1e-3
"""Least spread of a part, in units of that of all coordinates: below it are rounding errors."""


class Modes(NamedTuple):
    """Modes of T frames, the most probable one first.

    Attributes:
        frames: Frame numbers (T,).
        masses: Probability of each mode (T, K); 0 where a frame has fewer.
        means: Mean of each mode's draws (T, K, ...), of the state or of positions; NaN where a frame has fewer.
        names: The first dimension of a mean: names of coordinates or positions.
    """

    frames: Integers
    masses: Floats
    means: Floats
    names: list[str]


class Ambiguity(NamedTuple):
    """A stretch of frames that have several modes.

    Attributes:
        arose: Number of the first of these frames.
        resolved: Number of the first frame after them, None if there is none: the recording ends first.
        lesser: The most probability that all modes but the first have in one of the frames.
        place: The coordinate or position by which the two most probable modes differ most, in that frame.
        apart: By how much, in its unit.
    """

    arose: int
    resolved: int | None
    lesser: float
    place: str
    apart: float


def modes_over_time(tree: xr.DataTree, chosen: Integers | None = None, *, of: str = "state") -> Modes:
    """Find the modes of each frame of a result.

    Args:
        tree: The result; its chains or resampled particles count alike.
        chosen: Indices of frames; all if None.
        of: The flat state, or positions (chain, draw, frame, K, 3), which are compared by their shape as well.
    """
    values = draws_of(tree, of)
    if values is None:
        raise ValueError(f"the result has no draws of {of}")
    draws = np.moveaxis(values.reshape(-1, *values.shape[2:]), 0, 1)
    wanted = np.arange(len(draws)) if chosen is None else chosen
    masses, means = np.zeros((len(wanted), MAX_MODES)), np.full((len(wanted), MAX_MODES, *draws.shape[2:]), np.nan)
    for row, frame in enumerate(wanted):
        labels = mode_labels(_features(draws[frame].astype(np.float64)))
        for label in range(labels.max() + 1):
            masses[row, label] = (labels == label).mean()
            means[row, label] = draws[frame][labels == label].mean(0)
    most = int((masses > 0).any(0).sum())
    names = names_of(tree, "state_dim" if of == "state" else str(tree["posterior"][of].dims[3]))
    return Modes(frame_numbers(tree)[wanted], masses[:, :most], means[:, :most], names)


def _features(draws: Array) -> Array:
    """The space of the search for modes: standardised states (N, k); for positions (N, K, 3) the centre and offsets from it."""
    if draws.ndim == 2:
        return np.asarray(draws / np.maximum(draws.std(0), 1e-12))
    centre = draws.mean(1)
    return np.hstack([centre, (draws - centre[:, None]).reshape(len(draws), -1)])


def mode_labels(draws: Array) -> Integers:
    """Labels (N,) of the modes of draws (N, k), 0 for the most probable one; one mode for draws that are not finite."""
    labels = np.zeros(len(draws), np.int64)
    waiting = [0] if np.isfinite(draws).all() else []
    while waiting and labels.max() + 1 < MAX_MODES:
        members = np.flatnonzero(labels == waiting[-1])
        part = _divided(draws[members], max(MIN_SHARE * len(draws), MIN_DRAWS))
        if part is None:
            waiting.pop()
        else:
            labels[members[part]] = labels.max() + 1
            waiting.append(int(labels.max()))
    order = np.argsort(-np.bincount(labels), kind="stable")
    return np.argsort(order)[labels]


def _divided(draws: Array, least: float) -> Array | None:
    """Which of draws (N, k) are one of two modes (N,), each of so many draws at least; None if they are one."""
    count = len(draws)
    below = np.arange(1, count)[:, None]
    allowed = (below >= least) & (count - below >= least)
    if not allowed.any():
        return None
    centred = draws - draws.mean(0)
    along = np.hstack([centred, centred @ np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :_AXES]])
    ordered = np.sort(along, axis=0)
    lower, squares = np.cumsum(ordered, axis=0)[:-1], np.cumsum(ordered**2, axis=0)
    means = lower / below, (ordered.sum(0) - lower) / (count - below)
    variances = squares[:-1] / below - means[0] ** 2, (squares[-1] - squares[:-1]) / (count - below) - means[1] ** 2
    least_spread = _ROUNDING * np.sqrt(np.mean(centred**2))
    spread = np.sqrt(np.maximum((variances[0] + variances[1]) / 2, max(least_spread, 1e-12) ** 2))
    # of each axis the cut of the largest variance between its parts, which is that of the least variance within them
    cuts = np.argmax(np.where(allowed, below * (count - below) * (means[1] - means[0]) ** 2, -1.0), axis=0)
    apart = np.take_along_axis((means[1] - means[0]) / spread, cuts[None], axis=0)[0]
    axis = int(np.argmax(apart))
    return None if apart[axis] < MIN_APART else np.asarray(along[:, axis] > ordered[cuts[axis], axis])


def ambiguities(modes: Modes) -> list[Ambiguity]:
    """The stretches of frames that have several modes, in the order of time."""
    several = np.concatenate([[False], (modes.masses > 0).sum(1) > 1, [False]])
    edges = np.flatnonzero(several[1:] != several[:-1])
    return [_ambiguity(modes, *ends) for ends in edges.reshape(-1, 2).tolist()]


def _ambiguity(modes: Modes, first: int, after: int) -> Ambiguity:
    lesser = 1 - modes.masses[first:after, 0]
    frame = first + int(np.argmax(lesser))
    apart = modes.means[frame, 1] - modes.means[frame, 0]
    distance = np.linalg.norm(apart.reshape(len(apart), -1), axis=1)
    place = int(np.argmax(distance))
    resolved = int(modes.frames[after]) if after < len(modes.frames) else None
    return Ambiguity(int(modes.frames[first]), resolved, float(lesser.max()), modes.names[place], float(distance[place]))
