"""Steps of the posterior mean in units of the random walk, whether the motion is a learned one, and remedies.

If the state is a random walk with standard deviation q a frame, a filter's means m and variances P obey

    E[(m_t - m_{t-1})^2] = q^2 + P_{t-1} - P_t

(law of total variance, given the earlier data); a smoother's means move less. So the scale of a group of coordinates,
sqrt(sum (m_t - m_{t-1})^2 / q^2 / sum (1 + (P_{t-1} - P_t) / q^2)), is 1 where the walk is as wide as the steps are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.diagnostics.verdicts.verdict import (
    ERROR,
    INFO,
    WARNING,
    Findings,
    Remedy,
    Verdict,
    array_of,
    not_run,
    statistic,
    where,
)
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import provenance

STEPS_HIGH, STEPS_ERROR = 2.0, 3.0
"""Scales of a group of coordinates above which its verdict is a warning, an error."""
STEPS_LOW = 0.3
LEAP = 4.0
"""Steps of one coordinate, in units of the walk, that hardly ever occur: one in 16,000."""
LEAP_SHARE = 0.01
"""Share of larger ones that is a warning."""
LEAP_ERROR = 10.0
"""A single one that is an error."""
HOLDS = 0.5
"""Probability of the learned activity below which a frame is of other motion."""
OTHER_SHARE = 0.1
"""Share of such frames above which there is a warning."""
_MIN_SHARE = 0.25
POSITION, ANGLE = "sigma_position", "sigma_angle"


_ARGUMENTS = {"Translations": POSITION, "Angles": ANGLE}
_RATE = Remedy("check the frame rate")


class Steps(NamedTuple):
    """Steps (frame - 1, state_dim) of the posterior mean, from each frame to the next.

    Attributes:
        standardised: In units of the walk.
        expected: Expected mean of their squares.
    """

    standardised: Floats
    expected: Floats


def steps_of(tree: xr.DataTree) -> Steps | None:
    """Steps of a result; None where it does not tell its walk, or has one frame."""
    mean, deviation = (tree["summary"].dataset[f"state_{part}"].values.astype(float) for part in ("mean", "sd"))
    scale = array_of(tree, "inputs", "step_scale")
    if scale is None or scale.shape != mean.shape or len(mean) < 2:
        return None
    walks = np.where(scale > 0, scale, np.nan)[1:]
    variance = deviation**2
    gained = np.diff(-variance, axis=0) / walks**2
    error = _error_of_means(tree, variance)
    return Steps(np.diff(mean, axis=0) / walks, np.maximum(1 + gained, _MIN_SHARE) + (error[1:] + error[:-1]) / walks**2)


def _error_of_means(tree: xr.DataTree, variance: Floats) -> Floats:
    """Variances (frame, state_dim) of means of independent draws, as a closed form's are where the state is no pose."""
    draws = statistic(tree, "ess")
    if draws is None or not provenance(tree).get("closed form"):
        return np.zeros_like(variance)
    return np.asarray(variance / draws[:, None])


def estimated_steps(tree: xr.DataTree) -> Findings:
    """Steps that are too large for the random walk, all or some, or far smaller than it; by group of coordinates."""
    steps = steps_of(tree)
    if steps is None:
        yield not_run()
        return
    names = np.array(names_of(tree, "state_dim"))
    moves = np.array([name.rpartition(".")[2] in ("tx", "ty", "tz") for name in names])
    for group, members in (("Translations", moves), ("Angles", ~moves)):
        chosen = Steps(*(part[:, members] for part in steps))
        if np.isfinite(chosen.standardised).any():
            yield from _scale(tree, chosen, group)
            yield from _leaps(tree, chosen, group, names[members])


def _scale(tree: xr.DataTree, steps: Steps, group: str) -> Findings:
    known = np.isfinite(steps.standardised)
    scale = float(np.sqrt(np.sum(steps.standardised[known] ** 2) / np.sum(steps.expected[known])))
    text = f"{group} step {scale:.2f} times as far as their random walk"
    if scale > STEPS_HIGH:
        severity = ERROR if scale > STEPS_ERROR else WARNING
        wider = of_walk(tree, "raise {}", _ARGUMENTS[group])
        yield Verdict(severity, f"{text}: the filter lags behind;", (*wider, _RATE))
    if scale < STEPS_LOW and "smoother" not in provenance(tree) and not in_one_camera(tree):
        lower = of_walk(tree, "lower {}", _ARGUMENTS[group])
        yield Verdict(WARNING, f"{text}: intervals are too wide and means jitter;", (*lower, _RATE))


def _leaps(tree: xr.DataTree, steps: Steps, group: str, names: NDArray[np.str_]) -> Findings:
    """Single steps that the walk hardly ever makes."""
    sizes = np.nan_to_num(np.abs(steps.standardised) / np.sqrt(steps.expected))
    far = sizes > LEAP
    if far.mean() <= LEAP_SHARE and sizes.max() <= LEAP_ERROR:
        return
    frame, column = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    number = int(tree["posterior"].dataset["frame"].values[1:][frame])
    text = f"{group} leap, beyond {LEAP:.0f} times their random walk, in {where(tree, np.append(False, far.any(axis=1)))}"
    text += (
        f" (largest {sizes.max():.1f}, {names[column]} in frame {number}): another person, a left/right swap, or fast motion:"
    )
    remedies = Remedy("check the data there"), *of_walk(tree, "raise {}", _ARGUMENTS[group])
    yield Verdict(ERROR if sizes.max() > LEAP_ERROR else WARNING, text, remedies)


def learned_prior(tree: xr.DataTree) -> Findings:
    """Frames in which something else than the learned activity happens, by the posterior probability of the two."""
    probability = array_of(tree, "summary", "prior_mean")
    if probability is None:
        yield not_run()
        return
    other = probability < HOLDS
    if not other.any():
        return
    share = float(np.mean(other))
    text = f"The learned prior does not fit {share:.0%} of the frames ({where(tree, other)}): there the angles walk at random"
    if share <= OTHER_SHARE:
        yield Verdict(INFO, f"{text}.")
    else:
        remedies = Remedy("learn from motion of this kind (poseppl fit-motion)"), Remedy("track without {}", "prior")
        yield Verdict(WARNING, f"{text}. Better:", remedies)


def of_walk(tree: xr.DataTree, words: str, *arguments: str) -> tuple[Remedy, ...]:
    """To change arguments of the random walk, or what stands in its place where none of them is taken."""
    if variable(tree, "inputs", "posture_mean") is not None:
        return Remedy("use {}", "walk", "learned"), Remedy("use {}", "walk", "fixed")
    if provenance(tree).get("prior"):
        return Remedy("learn the prior from more people (poseppl fit-motion)"), Remedy("track without {}", "prior")
    return tuple(Remedy(words, argument) for argument in arguments)


def in_one_camera(tree: xr.DataTree) -> bool:
    """Whether these are keypoints in one camera: autocorrelated errors count as noise, which is wider than frames differ by."""
    return "layout" in provenance(tree) and len(names_of(tree, "camera")) == 1
