"""Track a scene: model, start, filter, run, result."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr

from poseppl.diagnostics import diagnose
from poseppl.errors import Argument, InputError, Phrase
from poseppl.filters import Filter, sharded
from poseppl.motion.bodies.body import Body, source_of_model
from poseppl.motion.bodies.unseen import Unseen, unseen_parts
from poseppl.motion.settings import TrackSettings, Walk
from poseppl.motion.tracking.assumed_stature import with_statures
from poseppl.motion.tracking.body_result import BodyNames, body_result
from poseppl.motion.tracking.default_body import chosen_model
from poseppl.motion.tracking.flesh_places import with_flesh
from poseppl.motion.tracking.learned_prior import digest_of, with_prior
from poseppl.motion.tracking.marker_learning import learn_markers
from poseppl.motion.tracking.problem import Problem, make_problem
from poseppl.motion.tracking.scene import Scene, SceneData
from poseppl.motion.tracking.walk_learning import learn_walk
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.checkpoint import Checkpoint
from poseppl.runs.outcome import result_kwargs
from poseppl.runs.predictive import Predict, predictive_checks
from poseppl.runs.run import Collect, Progress, Run, RunError, frame_inputs, run_filter
from poseppl.runs.smoothing import SmoothingRun

_ROOM = 2**28
"""Bytes of the draws that are stored by default."""
_PACKAGES = ("poseppl", "jax", "jaxlib", "numpyro", "blackjax", "numpy")


class Tracked(NamedTuple):
    """A scene that was tracked.

    Attributes:
        problem: The problem, which smoothers take unchanged.
        run: The filter's run; None where the result comes from a file, or no filter ran.
        result: The result, with diagnostics.
    """

    problem: Problem
    run: Run | None
    result: xr.DataTree


class TrackStopped(RunError):
    """A track that cannot go on.

    Attributes:
        tracked: The frames before; the attribute ``stopped`` of the result says why there are no more.
    """

    def __init__(self, error: RunError, tracked: Tracked) -> None:
        super().__init__(str(error), error.frame, error.done)
        self.tracked = tracked


def track(
    scene: Scene[SceneData],
    settings: TrackSettings | None = None,
    *,
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
) -> Tracked:
    """Track a scene.

    Args:
        scene: The scene.
        settings: How.
        progress: Reports the run's progress.
        checkpoint: Folder that the run is saved to after each chunk of frames.
        resume: Go on with the run that the folder holds.

    Returns:
        The problem, the run, and the result with diagnostics.

    Raises:
        InputError: A setting is out of range, or the body's walk cannot be learned.
        TrackStopped: The run cannot go on; has the result of the frames before.
        RunError: It cannot go on from the first frame.
        CheckpointError: The folder holds another run.
    """
    settings = settings or TrackSettings()
    tracking = prepare(scene, settings)
    problem = tracking.problem
    try:
        run = run_filter(
            tracking.filter,
            jax.random.key(settings.seed),
            problem.observations,
            problem.inputs,
            num_frames=len(scene.frames),
            collect=tracking.collect,
            predict=tracking.predict,
            chunk=settings.chunk,
            progress=progress,
            checkpoint=None if checkpoint is None else Checkpoint(checkpoint, tracking.described, resume=resume),
            on_failure=settings.on_failure,
            frame_numbers=scene.frames.tolist(),
            history_mib=settings.history_mib if problem.pose is None or settings.prior is not None else 0,
        )
    except RunError as error:
        if error.done is None:
            raise
        result = tracking.result(error.done, stopped=str(error))
        done = problem.first_frames(result["posterior"].sizes["frame"])
        raise TrackStopped(error, Tracked(done, error.done, result)) from error
    return Tracked(problem, run, tracking.result(run))


class Tracking(NamedTuple):
    """A scene's problem, the filter that is to solve it, and what is kept of it.

    Attributes:
        scene: The scene.
        problem: Its problem.
        filter: The filter.
        collect: Collector of each frame.
        predict: The predictive checks; None where the model predicts no data.
        described: Everything that the result depends on, for a checkpoint.
        record: The same and more, for the result.
    """

    scene: Scene[SceneData]
    problem: Problem
    filter: Filter
    collect: Collect
    predict: Predict | None
    described: Mapping[str, Any]
    record: Mapping[str, Any]

    def result(self, run: Run, **attributes: Any) -> xr.DataTree:
        """The result of a run of the scene, or of its first frames, with diagnostics."""
        result = result_of_scene(self.scene, self.problem, run, {**self.record, **attributes})
        return with_statures(diagnose(result), self.problem.model)


def prepare(scene: Scene[SceneData], settings: TrackSettings) -> Tracking:
    """Make ready to track a scene.

    Raises:
        InputError: A setting is out of range, or the body's walk cannot be learned.
    """
    name = settings.filter or usual_filter(scene, settings)
    walk, model = settings.walk or usual_walk(scene, settings), chosen_model(settings.model, scene.data.provenance)
    settings = replace(settings, model=model, walk=walk, filter=name)
    check_settings(settings)
    params = walk_params(scene.body, settings)
    if settings.markers == "learned":
        scene = learn_markers(scene, params)
    problem = problem_of_settings(scene, settings, params)
    built, options = FILTERS[name].build(problem.model, settings.options)
    built = on_devices(built, options, settings.devices)
    max_draws = settings.max_draws or affordable_draws(problem, int(options.get("num_chains", 1)))
    obstacle = problem.model.why_not_predictive(frame_inputs(problem.inputs, 0))
    described = {
        "model": settings.model,
        "model source": source_of_model(model),
        "filter": name,
        "settings": {**options, **params, "walk": settings.walk, "markers": settings.markers, "max_draws": max_draws},
        **scene.data.provenance,
        "prior": settings.prior,
        "prior digest": None if settings.prior is None else digest_of(settings.prior),
        "other motion": None if settings.prior is None else problem.follows is not None,
        "predictive checks": f"not available: {obstacle}" if obstacle else None,
        "versions": versions(),
    }
    attributes = {**described, "seed": settings.seed, "devices": settings.devices}
    of_state, of_points = problem.pose is None, built.points is not None
    predict = None if obstacle else predictive_checks(problem.model, of_state=of_state, of_points=of_points)
    record = {key: value for key, value in attributes.items() if value is not None}
    return Tracking(scene, problem, built, problem.collector(max_draws), predict, described, record)


def usual_filter(scene: Scene[SceneData], settings: TrackSettings) -> str:
    """Choose a scene's filter by what was measured (docs/choosing.md, "The default filter").

    For markers the Kalman filter has equal errors, better coverage and six times the speed. Silhouettes and keypoints have
    several modes, which chains find: half of the error.
    """
    several_modes = {"layout", "silhouettes"} & set(scene.data.provenance)
    return "assumed-density" if several_modes or settings.prior else "kalman"


def usual_walk(scene: Scene[SceneData], settings: TrackSettings) -> Walk:
    """The walk of a scene where none is asked for: one camera knows a person's distance by how people hold themselves."""
    scales = (settings.prior, settings.sigma_position, settings.sigma_angle)
    alone = "layout" in scene.data.provenance and len(scene.camera_names) == 1
    return "mean-reverting" if alone and scene.body.postures and scales == (None,) * 3 else "fixed"


def check_settings(settings: TrackSettings) -> None:
    """Refuse settings that do not go together.

    Raises:
        InputError: Two of them do not.
    """
    if settings.prior is not None and settings.markers == "learned":
        expected = Phrase("no ", Argument("markers", "learned"), " with it")
        raise InputError("the body is the prior's own", field=Argument("prior"), expected=expected)
    walks = settings.walk != "fixed" or settings.sigma_position is not None or settings.sigma_angle is not None
    if settings.prior is not None and walks:
        expected = Phrase(
            "no ", Argument("walk"), ", ", Argument("sigma_position"), " or ", Argument("sigma_angle"), " with it"
        )
        raise InputError("the random walk is the prior's own", field=Argument("prior"), expected=expected)


def problem_of_settings(scene: Scene[SceneData], settings: TrackSettings, params: Mapping[str, float]) -> Problem:
    """The scene's problem, with the walk or the prior that is asked for."""
    problem = make_problem(scene, params, mean_reverting=settings.walk == "mean-reverting")
    if settings.prior is not None:
        return with_prior(problem, scene, settings.prior, other_motion=settings.other_motion)
    return problem if settings.walk == "fixed" else learn_walk(problem)


def walk_params(body: Body, settings: TrackSettings) -> dict[str, float]:
    """The body's params with the scales of the random walk that are asked for.

    Raises:
        InputError: The body has no such parameter.
    """
    params = dict(body.params)
    for name, value in (("sigma_position", settings.sigma_position), ("sigma_angle", settings.sigma_angle)):
        if value is None:
            continue
        if name not in params:
            raise InputError("the model has no such parameter", field=Argument(name), expected="none with this model")
        params[name] = float(value)
    return params


def on_devices(filter: Filter, options: Mapping[str, Any], devices: int) -> Filter:
    """The filter on so many devices.

    Raises:
        InputError: There are fewer, or they cannot share the particles or chains evenly.
    """
    if devices == 1:
        return filter
    name = "num_chains" if "num_chains" in options else "num_particles"
    if devices > 1 and options.get(name, devices) % devices:
        shared = f"{options[name]} {name.removeprefix('num_')}"
        expected = f"a number that divides the {shared}"
        raise InputError(f"{devices} devices cannot share {shared}", field=Argument("devices"), expected=expected)
    try:
        return sharded(filter, devices)
    except ValueError as error:
        raise InputError(str(error), field=Argument("devices")) from error


def affordable_draws(problem: Problem, chains: int) -> int:
    """How many draws of a chain (or of all particles, at most 1000) fit into the room for results."""
    frames = len(jax.tree.leaves(problem.observations)[0])
    cameras, markers = problem.num_cameras, len(problem.body.tree.marker_names)
    values = 2 * problem.model.dimension + markers * (3 + 2 * cameras)
    draws = _ROOM // (4 * values * frames * chains)
    return int(max(2, min(draws, 1000)))


def result_of_scene(
    scene: Scene[SceneData], problem: Problem, run: Run | SmoothingRun, attrs: Mapping[str, Any]
) -> xr.DataTree:
    """The result of a run of a scene, or of its first frames, or of its smoothing, without diagnostics."""
    count = len(run.info.ess)  # a run that stopped has fewer frames than its scene
    scene, parts = scene.first_frames(count), result_kwargs(run)
    parts["sample_stats"].setdefault("failed", np.zeros(count, bool))  # a smoothing without a filter has no such frames
    parts["sample_stats"] |= scene.data.quality(scene, parts["summary"]["state_mean"])
    body, tree = scene.body, scene.body.tree
    free = list(body.free_coordinates)
    names = [tree.coordinate_names[index] for index in free]
    truth = None if scene.states is None else {"state": scene.states[:, free], "markers": scene.markers}
    pairs = [[tree.marker_names.index(end) for end in edge] for edge in body.edges]
    attributes = {
        "input": scene.source,
        "lengths": {name: round(float(value), 6) for name, value in body.lengths.items()},
        "residual_mm": scene.residual,
        **_unseen(body, scene.data.observed(body).get("points")),
    }
    result = body_result(
        **{**parts, "attrs": {**attrs, **attributes, **parts["attrs"]}},
        names=BodyNames(names, tree.marker_names, scene.camera_names),
        observed=scene.data.observed(scene.body),
        faults=scene.data.faults,
        truth=truth,
        cameras={name: None if leaf is None else np.asarray(leaf) for name, leaf in scene.cameras._asdict().items()},
        edges=pairs,
        root=body.root,
        inputs=problem.record(slice(count)),
        frames=scene.frames,
        rate=scene.rate,
    )
    return with_flesh(result, problem)


def _unseen(body: Body, points: Any) -> dict[str, Any]:
    """Unseen markers and angles of a body, for the record; empty if all is seen, or if data are not points."""
    found = Unseen() if points is None else unseen_parts(body, np.isfinite(points).all(-1).any((0, 1)))
    return {"unseen": {name: list(names) for name, names in found._asdict().items()}} if any(found) else {}


def versions() -> dict[str, str]:
    """Versions of what decides a result."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}
