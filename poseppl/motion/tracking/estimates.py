"""Joint positions and angles of a result with intervals, over all draws, for exports and tables."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.opensim import Coordinate, circular_summary, opensim_coordinates, states_to_values
from poseppl.motion.bodies.unseen import Unseen
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.motion.tracking.walk import ASSUMED_RATE
from poseppl.runs.contents import flat_draws, frame_numbers, names_of, variable
from poseppl.runs.results import provenance


class Clock(NamedTuple):
    """When the frames of a result were.

    Attributes:
        frames: Numbers (T,).
        times: Seconds (T,): frame 0 is at 0.
        rate: Frames a second, of frames that are as far apart as most.
        assumed: Whether nobody has said the rate, and 30 is taken.
    """

    frames: Integers
    times: Floats
    rate: float
    assumed: bool


class Estimates(NamedTuple):
    """Quantities (T, ...) of a result: their means, the ends of central intervals, and standard deviations."""

    mean: Floats
    lower: Floats
    upper: Floats
    spread: Floats


def clock_of(tree: xr.DataTree) -> Clock:
    """The frames of a result in time."""
    frames, recorded = frame_numbers(tree), tree.attrs.get("rate")
    rate = ASSUMED_RATE if recorded is None else float(recorded)
    gaps = np.diff(frames)
    usual = float(np.median(gaps)) if gaps.size else 1.0
    return Clock(frames, frames / usual / rate, rate, recorded is None)


def unseen_of(tree: xr.DataTree) -> Unseen:
    """Which joints and coordinates of a result no camera saw: their values are the prior's alone.

    Raises:
        InputError: The file's list is none.
    """
    recorded = provenance(tree).get("unseen", {})
    parts: list[Any] = [recorded.get(name, []) for name in Unseen._fields] if isinstance(recorded, dict) else [None]
    if not all(isinstance(part, list) and all(isinstance(name, str) for name in part) for part in parts):
        raise InputError("the result's list of unseen joints is none", field="unseen", expected="lists of names")
    return Unseen(*map(tuple, parts))


def place_estimates(tree: xr.DataTree, level: float = 0.9) -> tuple[list[str], Estimates]:
    """The joints' names and places (T, K, 3), mm, Z up.

    Args:
        tree: The result.
        level: Level of the intervals of each coordinate.

    Raises:
        InputError: The level is no share, or the result holds no joints.
    """
    ends, draws = _ends(level), variable(tree, "posterior", "markers")
    mean, spread = (variable(tree, "summary", f"markers_{part}") for part in ("mean", "sd"))
    if draws is None or mean is None or spread is None:
        raise InputError("the result has no joints in space", expected="a result of poseppl track or smooth of a body")
    kept, levels = variable(tree, "summary", "markers_quantile"), tree["summary"].dataset.get("quantile")
    at = [] if levels is None else [np.flatnonzero(np.isclose(levels.values, end)) for end in ends]
    if kept is not None and at and all(index.size for index in at):  # made of all draws or particles
        lower, upper = (kept[:, index[0]] for index in at)
    else:
        lower, upper = np.quantile(draws.reshape(-1, *draws.shape[2:]), ends, axis=0)
    arrays = (np.asarray(values, np.float64) for values in (mean, lower, upper, spread))
    return names_of(tree, "marker"), Estimates(*arrays)


def angle_estimates(
    tree: xr.DataTree, level: float = 0.9, model: str | None = None
) -> tuple[tuple[Coordinate, ...], Estimates]:
    """The coordinates of OpenSim's models, and their values (T, coordinates), degrees and m.

    Args:
        tree: The result.
        level: Level of the intervals.
        model: Builder of the body; needed where the result's own is not installed, for a file does not choose what is run.

    Raises:
        InputError: The level is no share, or the model cannot be built.
    """
    ends = _ends(level)
    coordinates, values = angle_draws(tree, model)
    turning = np.array([each.unit == "degrees" for each in coordinates])
    mean, spread, (lower, upper) = circular_summary(values, ends)
    moved = values[..., ~turning]
    mean[:, ~turning], (lower[:, ~turning], upper[:, ~turning]) = moved.mean(0), np.quantile(moved, ends, axis=0)
    spread[:, ~turning] = moved.std(0, ddof=1) if len(moved) > 1 else 0.0
    return coordinates, Estimates(mean, lower, upper, spread)


def angle_draws(tree: xr.DataTree, model: str | None = None) -> tuple[tuple[Coordinate, ...], Floats]:
    """The coordinates of OpenSim's models, and draws (S, T, coordinates) of their values, degrees within half a turn, and m.

    Args:
        tree: The result.
        model: Builder of the body; needed where the result's own is not installed, for a file does not choose what is run.

    Raises:
        InputError: The model cannot be built.
    """
    body = recorded_model(tree, model).body
    kept = np.asarray(flat_draws(tree).values)
    draws = kept.reshape(-1, *kept.shape[2:])
    free = list(body.free_coordinates)
    if len(free) < body.tree.dimension:
        clamped = variable(tree, "inputs", "states")
        if clamped is None:
            raise InputError("the result does not state its clamped joints", expected="a result of this version")
        whole = np.tile(np.asarray(clamped, draws.dtype), (len(draws), 1, 1))
        whole[:, :, free] = draws
        draws = whole
    values = np.asarray(states_to_values(body, jnp.asarray(draws, float)), np.float64)
    return opensim_coordinates(body), values


def _ends(level: float) -> tuple[float, float]:
    if not 0.0 < level < 1.0:
        raise InputError(f"{level:g}", field=Argument("level"), expected="a share between 0 and 1, such as 0.9")
    return (1 - level) / 2, (1 + level) / 2
