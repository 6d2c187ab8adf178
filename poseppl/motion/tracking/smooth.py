"""Smooth a tracking result: every frame given all data, also those after it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
import xarray as xr

from poseppl.arrays import Floats, Integers
from poseppl.diagnostics import diagnose
from poseppl.errors import Argument, FilePath, InputError, Phrase, brief
from poseppl.motion.geometry import KinematicTree
from poseppl.motion.tracking.assumed_stature import at_mean_stature, with_statures
from poseppl.motion.tracking.body_sizes import MeasuredLengths, lengths_per_place
from poseppl.motion.tracking.flesh_places import with_flesh
from poseppl.motion.tracking.lasting_errors import ar1_inputs, filtered_poses, lasting_of, with_ar1_noise, with_no_errors
from poseppl.motion.tracking.learned_prior import prior_of_result
from poseppl.motion.tracking.marginal_smoothing import NUM_DRAWS, smooth_marginally
from poseppl.motion.tracking.problem import Problem, problem_of_result
from poseppl.motion.tracking.recorded_model import offsets_per_length
from poseppl.motion.tracking.refiltering import filter_again
from poseppl.motion.tracking.track import Tracked, affordable_draws, versions
from poseppl.motion.tracking.triangulated_start import triangulated_places
from poseppl.runs.algorithms import SMOOTHERS
from poseppl.runs.contents import HISTORY, frame_numbers, group_of
from poseppl.runs.outcome import history_of_result, smoothed_result
from poseppl.runs.posterior_checks import check_posterior
from poseppl.runs.results import provenance
from poseppl.runs.smoothing import SmoothingRun, run_smoother


class SmoothSettings(NamedTuple):
    """How a result is smoothed.

    Attributes:
        method: Name of the smoother, one of :data:`poseppl.runs.algorithms.SMOOTHERS`.
        options: Its settings by the names of its arguments, such as ``num_draws``; absent ones are its defaults.
        seed: Seed of the smoother.
        max_draws: Draws kept of each chain, or of all particles; as many as fit into 256 MiB if None.
        model: Builder of the body; needed where the result's own is not installed, for a file does not choose what is run.
        errors: "independent" ones of the points from frame to frame, as the filter has them, or "lasting" ones, as detectors of
            keypoints have them; see :mod:`poseppl.motion.tracking.lasting_errors`.
        prior: File of the learned prior that a result was tracked with, where only the result is given: it is not in it.
    """

    method: str = "trajectory"
    options: Mapping[str, Any] = {}
    seed: int = 0
    max_draws: int | None = None
    model: str | None = None
    errors: Literal["independent", "lasting"] = "independent"
    prior: FilePath | None = None


def smooth(tracked: Tracked | xr.DataTree, settings: SmoothSettings | None = None) -> xr.DataTree:
    """Smooth a result of :func:`poseppl.motion.tracking.track.track`.

    The smoother starts from the filter's history, or from the draws where the result has none. A smoother that follows
    ancestors needs all particles of the filter, which runs again if the result does not have them.

    Args:
        tracked: Output of `track`, whose problem is solved again, or only its result, for example from a file. The problem is
            then rebuilt from the result. This is impossible for silhouettes, because a result does not contain their pictures.
        settings: How.

    Returns:
        The smoothed result, with diagnostics; its provenance holds that of the filter.

    Raises:
        InputError: The result does not contain its inputs, its model has changed or is not installed, or a setting is out of
            range. Also a smoother that follows ancestors, if the filter keeps no genealogy.
        RunError: The filter is run again, and cannot go on.
        SmoothingError: The smoothed states are not finite.
    """
    settings = settings or SmoothSettings()
    tree = tracked.result if isinstance(tracked, Tracked) else tracked
    known = provenance(tree)
    if "smoother" in known:
        raise InputError("the result is smoothed already", expected="the result of a filter, which the smoother starts from")
    if settings.errors not in ("independent", "lasting"):
        raise InputError(brief(settings.errors), field=Argument("errors"), expected="independent or lasting")
    problem = tracked.problem if isinstance(tracked, Tracked) else _problem_of_result(tree, settings)
    lasting = settings.errors == "lasting"
    if "prior" in known:
        _check_prior(tree, lasting)
    if lasting and problem.num_cameras < 2:
        raise InputError(
            "one camera cannot distinguish autocorrelated errors from a person's distance",
            field=Argument("errors"),
            expected="independent, or a result of two cameras or more",
        )
    if lasting and settings.method == "laplace":
        return _smoothed_marginally(tree, problem, settings)
    if lasting:
        problem = with_ar1_noise(problem, frame_numbers(tree), tree.attrs.get("rate"), lasting=lasting_of(known))
    smoother, options = SMOOTHERS[settings.method].build(problem.model, settings.options)
    if lasting and smoother.requires_genealogy:
        raise InputError(
            f"{settings.method} follows the filter's particles, which have none",
            field=Argument("errors"),
            expected="independent",
        )
    key = jax.random.key(settings.seed)
    again = smoother.requires_genealogy and "ancestor" not in group_of(tree, HISTORY)
    history = filter_again(tree, problem) if again else history_of_result(at_mean_stature(tree), jax.random.fold_in(key, 0))
    run = run_smoother(
        smoother,
        key,
        with_no_errors(history, problem) if lasting else history,
        problem.observations,
        problem.inputs,
        collect=problem.collector(settings.max_draws or affordable_draws(problem, int(options.get("num_chains", 1)))),
    )
    result = with_flesh(smoothed_result(run, tree, _attributes(known, settings, options)), problem)
    if lasting or problem.pose is not None:  # the smoother's state is not that of the result
        return diagnose(result)
    checked = check_posterior(result, problem.model, jax.random.fold_in(key, 1), problem.inputs, data=problem.observations)
    return with_statures(diagnose(checked), problem.model)


def _problem_of_result(tree: xr.DataTree, settings: SmoothSettings) -> Problem:
    if settings.prior is not None:
        return prior_of_result(tree, settings.prior, settings.model)
    return problem_of_result(tree, settings.model)


def _check_prior(tree: xr.DataTree, lasting: bool) -> None:
    """Refuse what a learned prior's results cannot be smoothed with: their states are other than the draws, which are poses."""
    if lasting:
        raise InputError("a learned prior has independent errors", field=Argument("errors"), expected="independent")
    if "state" not in group_of(tree, HISTORY):
        expected = Phrase("a result tracked with more ", Argument("history_mib"))
        raise InputError("the result does not contain its particles, which a smoother starts from", expected=expected)


def _smoothed_marginally(tree: xr.DataTree, problem: Problem, settings: SmoothSettings) -> xr.DataTree:
    """A result smoothed with the detector's autocorrelated errors, from the filter's poses."""
    poses = filtered_poses(history_of_result(tree, jax.random.key(settings.seed)), problem)
    frames, rate, known = frame_numbers(tree), tree.attrs.get("rate"), provenance(tree)
    points = np.asarray(tree["observed_data"].dataset["points"].values)
    points = np.where(np.asarray(tree["sample_stats"].dataset["failed"].values, bool)[:, None, None, None], np.nan, points)
    offsets = offsets_per_length(tree, settings.model) if known.get("lengths measured") is True else None
    run, options = smooth_points(problem, points, frames, rate, known, offsets, poses, settings)
    return diagnose(with_flesh(smoothed_result(run, tree, _attributes(known, settings, options)), problem))


def _attributes(known: Mapping[str, Any], settings: SmoothSettings, options: Mapping[str, Any]) -> dict[str, Any]:
    """Provenance of a smoothing."""
    return {
        "model": settings.model or known["model"],
        "smoother": settings.method,
        "smoother settings": options,
        "errors": settings.errors,
        "model of the filter": settings.errors != "lasting",
        "smoother seed": settings.seed,
        "versions": versions(),
    }


def smooth_points(
    problem: Problem,
    points: Floats,
    frames: Integers,
    rate: float | None,
    known: Mapping[str, Any],
    offsets: KinematicTree | None,
    poses: Floats,
    settings: SmoothSettings,
) -> tuple[SmoothingRun, dict[str, Any]]:
    """Smooth a body's points with autocorrelated errors, which are marginalised, by Laplace's approximation.

    Args:
        problem: The filter's problem.
        points: (T, C, K, 2) image points, NaN where not seen.
        frames: Their numbers (T,).
        rate: Frames a second; 30 if None.
        known: Provenance; ``camera covariance`` is what is not known of the cameras' poses.
        offsets: How the tree's offsets change with each length, if lengths were measured in these points; None if exact.
        poses: (T, d) to start from.
        settings: How.

    Returns:
        The smoothing, and all settings of the smoother.

    Raises:
        InputError: As of :func:`~poseppl.motion.tracking.lasting_errors.ar1_inputs`, or a setting is out of range.
    """
    laplace = SMOOTHERS["laplace"]
    given = {"num_draws": NUM_DRAWS, **settings.options}
    laplace.check(given)
    options = laplace.complete(given)
    lengths = None if offsets is None else _measured_lengths(problem, points, offsets)
    covariance = _camera_covariance(known, problem)
    inputs = ar1_inputs(problem, frames, rate, covariance, lengths, poses, lasting_of(known))
    return smooth_marginally(inputs, points, poses, seed=settings.seed, max_draws=settings.max_draws, **options), options


def _measured_lengths(problem: Problem, points: Floats, offsets: KinematicTree) -> MeasuredLengths:
    """How the lengths of a body were measured in its points, which weigh as much as they are sure."""
    return MeasuredLengths(offsets, lengths_per_place(problem.body, triangulated_places(problem, points)))


def _camera_covariance(known: Mapping[str, Any], problem: Problem) -> Floats | None:
    """Covariance (6 C, 6 C) of what remains of the errors of a result's cameras; None where they were not sought."""
    recorded, size = known.get("camera covariance"), 6 * problem.num_cameras
    if recorded is None:
        return None
    try:
        covariance = np.array(recorded, np.float64).reshape(size, size)
        np.linalg.cholesky(covariance)
    except (TypeError, ValueError) as error:  # NumPy's LinAlgError is a ValueError
        problem_told = "the result's covariance of its cameras' errors is none"
        raise InputError(problem_told, field="camera covariance", expected=f"{size} x {size} numbers") from error
    return covariance
