"""Smooth a tracking result: every frame given all data, also those after it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import xarray as xr

from poseppl.diagnostics import diagnose
from poseppl.errors import InputError
from poseppl.motion.tracking.problem import problem_of_result
from poseppl.motion.tracking.refiltering import filter_again
from poseppl.motion.tracking.track import affordable_draws, versions
from poseppl.runs.algorithms import SMOOTHERS
from poseppl.runs.outcome import history_of_result, smoothed_result
from poseppl.runs.results import provenance
from poseppl.runs.smoothing import run_smoother


class SmoothSettings(NamedTuple):
    """How a result is smoothed.

    Attributes:
        method: Name of the smoother, one of :data:`poseppl.runs.algorithms.SMOOTHERS`.
        options: Its settings by the names of its arguments, such as ``num_draws``; absent ones are its defaults.
        seed: Of the smoother.
        max_draws: Draws kept of each chain, or of all particles; as many as fit into 256 MiB if None.
        model: Builder of the body; needed where the result's own is not installed, for a file does not choose what is run.
    """

    method: str = "trajectory"
    options: Mapping[str, Any] = {}
    seed: int = 0
    max_draws: int | None = None
    model: str | None = None


def smooth(tree: xr.DataTree, settings: SmoothSettings | None = None) -> xr.DataTree:
    """Smooth a result of :func:`poseppl.motion.tracking.track.track`.

    The smoother starts from the draws that the result holds, and the model is built anew from its provenance. A smoother that
    follows ancestors starts from all particles of the filter, which is run again.

    Args:
        tree: The result.
        settings: How.

    Returns:
        The smoothed result, with diagnostics; its provenance holds that of the filter.

    Raises:
        InputError: The result does not tell its inputs, its model has changed or is not installed, or a setting is out of
            range, or its filter keeps no genealogy for a smoother that follows ancestors.
        RunError: The filter is run again, and cannot go on.
        SmoothingError: The smoothed states are not finite.
    """
    settings = settings or SmoothSettings()
    known = provenance(tree)
    if "smoother" in known:
        raise InputError("the result is smoothed already", expected="the result of a filter, which the smoother starts from")
    problem = problem_of_result(tree, settings.model)
    smoother, options = SMOOTHERS[settings.method].build(problem.model, settings.options)
    run = run_smoother(
        smoother,
        jax.random.key(settings.seed),
        filter_again(tree, problem) if smoother.follows_ancestors else history_of_result(tree),
        problem.observations,
        problem.inputs,
        collect=problem.collector(settings.max_draws or affordable_draws(problem, int(options.get("num_chains", 1)))),
    )
    attrs = {
        "model": settings.model or known["model"],
        "smoother": settings.method,
        "smoother settings": options,
        "smoother seed": settings.seed,
        "versions": versions(),
    }
    return diagnose(smoothed_result(run, tree, attrs))
