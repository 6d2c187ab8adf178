"""Steps of the posterior mean in units of the random walk.

Where the state walks at random with standard deviation q a frame, a filter's means m and variances P obey

    E[(m_t - m_{t-1})^2] = q^2 + P_{t-1} - P_t

(law of total variance, given the earlier data); a smoother's means move less. So the scale of a group of coordinates,
sqrt(sum (m_t - m_{t-1})^2 / q^2 / sum (1 + (P_{t-1} - P_t) / q^2)), is 1 where the walk is as wide as the steps are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Verdict, where
from poseppl.results import provenance

Floats = NDArray[np.float64]

STEPS_HIGH, STEPS_ERROR = 2.0, 3.0
"""Scales of a group of coordinates above which its verdict is a warning, an error."""
STEPS_LOW = 0.3
LEAP = 4.0
"""Steps of one coordinate, in units of the walk, that hardly ever occur: one in 16,000."""
LEAP_SHARE = 0.01
_LEAST_SHARE = 0.25
_GROUPS = {"--sigma-position": "Translations", "--sigma-angle": "Angles"}


class Steps(NamedTuple):
    """Steps (frame - 1, dof) of the posterior mean, from each frame to the next.

    Attributes:
        standardised: In units of the walk.
        expected: What their squares should be on average.
    """

    standardised: Floats
    expected: Floats


def steps_of(tree: xr.DataTree) -> Steps | None:
    """Steps of a result; None where it does not tell its walk, or has one frame."""
    if "inputs" not in tree.children or "step_scale" not in tree["inputs"].dataset:
        return None
    summary = tree["summary"].dataset
    mean, variance = summary["state_mean"].values.astype(float), np.square(summary["state_sd"].values.astype(float))
    scale = np.asarray(tree["inputs"].dataset["step_scale"].values, float)
    if scale.shape != mean.shape or len(mean) < 2:
        return None
    walks = np.where(scale > 0, scale, np.nan)[1:]
    gained = np.diff(-variance, axis=0) / walks**2
    return Steps(np.diff(mean, axis=0) / walks, np.maximum(1 + gained, _LEAST_SHARE))


def estimated_steps(tree: xr.DataTree) -> list[Verdict]:
    """Steps that are too large for the random walk, or far smaller than it; by group of coordinates."""
    steps = steps_of(tree)
    if steps is None:
        return []
    names = [str(name) for name in tree["posterior"].dataset["dof"].values]
    moves = np.array([name.rpartition(".")[2] in ("tx", "ty", "tz") for name in names])
    groups = zip(_GROUPS, (moves, ~moves), strict=True)
    found = [_group(tree, steps, names, option, members) for option, members in groups if members.any()]
    return [verdict for verdict in found if verdict is not None]


def _group(tree: xr.DataTree, steps: Steps, names: list[str], option: str, members: NDArray[np.bool_]) -> Verdict | None:
    sizes = np.abs(steps.standardised[:, members])
    if not np.isfinite(sizes).any():
        return None
    scale = float(np.sqrt(np.nansum(sizes**2) / np.nansum(np.where(np.isfinite(sizes), steps.expected[:, members], np.nan))))
    leaps = sizes > LEAP * np.sqrt(steps.expected[:, members])
    frame, dof = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
    coordinate, number = np.array(names)[members][dof], int(tree["posterior"].dataset["frame"].values[1:][frame])
    largest = f"largest {sizes[frame, dof]:.1f}, {coordinate} in frame {number}"
    text = f"{_GROUPS[option]} step {scale:.2f} times as far as their random walk"
    if scale > STEPS_HIGH or leaps.mean() > LEAP_SHARE:
        inside = np.append(False, leaps.any(axis=1))
        seldom = f", beyond {LEAP:.0f} times it in {where(tree, inside)}" if inside.any() else ""
        severity = ERROR if scale > STEPS_ERROR else WARNING
        return Verdict(severity, f"{text} ({largest}{seldom}): it cannot follow; raise {option}, or check the frame rate.")
    if scale < STEPS_LOW and "smoother" not in provenance(tree):
        return Verdict(WARNING, f"{text}: intervals are wide and means jitter; lower {option}, or check the frame rate.")
    return None
