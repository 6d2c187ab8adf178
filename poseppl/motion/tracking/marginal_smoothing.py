"""Smoothing of a body's points whose autocorrelated errors are marginalised: poses, places and points, as a result keeps them.

The Gaussian about the mode gives moments of the state without Monte Carlo error; those of places and points are of draws.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from poseppl_models.bodies.random_walk import joint_sites
from scipy.special import ndtri
from threadpoolctl import threadpool_limits

from poseppl.arrays import Floats
from poseppl.motion.geometry.recorded_frames import MarkerKinematics, points_of_erring_cameras
from poseppl.motion.tracking.seen_body import SeenBody, seen_body
from poseppl.runs.collectors import Draws
from poseppl.runs.labels import QUANTILES
from poseppl.runs.smoothing import SmoothingError, SmoothingRun
from poseppl.smoothers.base import smoothing_info
from poseppl.smoothers.marginal_errors import Around, Mode, find_mode, gaussian_around

NUM_DRAWS = 200
"""Trajectories that are drawn by default: moments of the state need none."""
_NUMBERS = 2**26
"""In the draws of a trajectory; a long recording has fewer draws."""
_ROOM = 2**28
"""Bytes of the draws that are stored by default."""
_LEAST = 20
"""Draws at least."""
_FRAMES = 16
"""Whose draws are evaluated together, so that they stay in the cache."""


class _Drawn(NamedTuple):
    """Draws of N trajectories in some frames: poses (T, N, d), shifts (T, N, K, 3), lengths (N, L), camera errors (N, E)."""

    poses: Any
    shifts: Any
    lengths: Any
    errors: Any


def smooth_marginally(
    inputs: Any, points: Floats, poses: Floats, *, seed: int, num_draws: int, max_draws: int | None, num_mode_steps: int = 100
) -> SmoothingRun:
    """Smooth.

    Args:
        inputs: Inputs of the programs of ``poseppl_models.bodies.detected_points``, constants wrapped.
        points: (T, C, K, 2) image points, NaN where not seen.
        poses: (T, d) to start from.
        seed: Seed of the draws.
        num_draws: Trajectories that are drawn; fewer if a recording is long.
        max_draws: How many of them are kept; as many as fit into 256 MiB if None.
        num_mode_steps: Gauss-Newton steps at most.

    Raises:
        SmoothingError: The smoothed states are not finite.
    """
    started, processor = time.perf_counter(), time.process_time()
    body, rng = seen_body(inputs, points), np.random.default_rng(seed)
    problem = body.problem()
    num_draws = min(num_draws, max(_LEAST, _NUMBERS // problem.chains.own.size))
    with threadpool_limits(limits=1, user_api="blas"):  # threads of small matrices wait for each other, and spin
        mode = find_mode(problem, body.states(poses), most=num_mode_steps)
        around = gaussian_around(problem, mode, rng, num_draws, body.unchanging(mode.x))
    if not np.isfinite(around.variance).all() or not np.isfinite(around.steps).all():
        raise SmoothingError("the smoothed states are not finite: the model breaks down")
    outputs = jax.tree.map(np.asarray, _outputs(body, mode, around, rng, max_draws or _affordable_draws(body, len(poses))))
    info = smoothing_info(len(poses), jnp.asarray(float(num_draws)), num_gradient=mode.num_steps * len(poses))
    properties = {"closed form": True, "joint": True}
    seconds, spent = time.perf_counter() - started, time.process_time() - processor
    return SmoothingRun(outputs, jax.tree.map(np.asarray, info), num_draws, 0.0, seconds, properties, spent)


def _affordable_draws(body: SeenBody, num_frames: int) -> int:
    """How many draws fit into the room for them."""
    markers, cameras = len(body.tree.marker_names), body.points.shape[1]
    values = markers * (6 + 2 * cameras) + 3 * body.dimension + len(body.inputs.errors.length_root) + 6 * cameras
    return int(max(2, _ROOM // (4 * values * num_frames)))


def _outputs(body: SeenBody, mode: Mode, around: Around, rng: np.random.Generator, max_draws: int) -> Draws:
    """Outputs of all frames, in the form of a collector of draws."""
    count, width, num_lengths = around.steps.shape[1], body.dimension, len(body.inputs.errors.length_root)
    kept = np.unique(np.linspace(0, count - 1, min(max_draws, count)).astype(int))
    lengths, errors = np.split(around.unchanging, [num_lengths], 1)
    unseen = _unseen_shifts(body, len(mode.x), count, rng)
    parts: list[tuple[dict[str, Any], ...]] = []
    for rows in _blocks(len(mode.x)):
        x = mode.x[rows, None] + around.steps[rows]
        drawn = _Drawn(x[..., :width], body.shifts(x) + next(unseen), lengths, errors)
        parts.append(_kept_of_block(body, drawn, x[..., width : 2 * width], kept))
    extras, sites, summary = (
        {name: jnp.asarray(np.concatenate([part[i][name] for part in parts])) for name in parts[0][i]} for i in range(3)
    )
    state = sites.pop("state")
    spans = joint_sites(body.tree.coordinates)
    sites = {**{name: state[..., span] for name, span in spans.items()}, **sites}
    summary |= _exact_summary(body, mode, around, spans)
    return Draws(state, sites, extras, summary)


def _kept_of_block(body: SeenBody, drawn: _Drawn, velocities: Floats, kept: Any) -> tuple[dict[str, Any], ...]:
    """Draws of extras and of sites that are kept of some frames, (T, 1, draws, ...), and moments of the extras."""
    markers, points = _places_of(body, drawn)
    extras = {"markers": markers[:, None, kept], "points": points[:, None, kept]}
    summary: dict[str, Any] = {}
    for name, values in (("markers", markers), ("points", points)):
        summary |= {f"{name}_{moment}": found for moment, found in _moments(values).items()}
    sites = {"state": drawn.poses, "shift": drawn.shifts, "velocity": velocities}
    draws = {name: values[:, None, kept].astype(np.float32) for name, values in sites.items()}
    for name, values in (("length", drawn.lengths), ("camera_error", drawn.errors)):
        if values.shape[1]:
            same = values[None, None, kept].astype(np.float32)
            draws[name] = np.broadcast_to(same, (len(markers), *same.shape[1:]))
    return extras, draws, summary


def _moments(values: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Mean, standard deviation and quantiles of draws (T, N, ...); those of sorted columns are the fastest."""
    count = values.shape[1]
    columns = np.ascontiguousarray(np.moveaxis(values, 1, -1))
    columns.sort(-1)
    at = np.asarray(QUANTILES) * (count - 1)
    low = np.minimum(at.astype(int), max(count - 2, 0))
    share = (at - low).astype(np.float32)
    quantiles = (1 - share) * columns[..., low] + share * columns[..., np.minimum(low + 1, count - 1)]
    mean = columns.mean(-1)
    columns -= mean[..., None]
    deviation = np.sqrt(np.einsum("...n,...n->...", columns, columns) / count)
    return {"mean": mean, "sd": deviation, "quantile": np.ascontiguousarray(np.moveaxis(quantiles, -1, 1))}


def _exact_summary(body: SeenBody, mode: Mode, around: Around, spans: dict[str, slice]) -> dict[str, Any]:
    """Means, standard deviations and quantiles of the state and its sites, by the Gaussian."""
    width, errors = body.dimension, body.inputs.errors
    spread = np.sqrt(around.variance)
    shift, shift_spread = body.shifts(mode.x), body.shifts(spread)
    unseen = np.ones(len(body.tree.marker_names), bool)
    unseen[body.markers] = False
    shift_spread[:, unseen] = float(errors.shift_scale)
    moments = {
        "state": (mode.x[:, :width], spread[:, :width]),
        "shift": (shift, shift_spread),
        "velocity": (mode.x[:, width : 2 * width], spread[:, width : 2 * width]),
    }
    moments |= {name: tuple(part[:, span] for part in moments["state"]) for name, span in spans.items()}  # type: ignore[misc]
    for name, root in (("length", errors.length_root), ("camera_error", errors.camera_root)):
        if len(root):
            own = np.broadcast_to(np.linalg.norm(root, axis=1), (len(mode.x), len(root)))
            moments[name] = (np.zeros_like(own), own)
    summaries: dict[str, Any] = {}
    levels = ndtri(QUANTILES)
    for name, (mean, own) in moments.items():
        each = mean[:, None] + levels.reshape(-1, *[1] * (mean.ndim - 1)) * own[:, None]
        summaries |= {f"{name}_mean": mean, f"{name}_sd": own, f"{name}_quantile": each}
    return {name: jnp.asarray(values, jnp.float32) for name, values in summaries.items()}


def _unseen_shifts(body: SeenBody, num_frames: int, count: int, rng: np.random.Generator) -> Iterator[Floats]:
    """By blocks of frames, places (T, N, K, 3) beside joints that nobody sees, by their prior; 0 of the others."""
    unseen = np.setdiff1d(np.arange(len(body.tree.marker_names)), body.markers)
    errors = body.inputs.errors
    kept, now = np.asarray(errors.shift_kept, np.float64), np.zeros((count, len(unseen), 3))
    left = np.concatenate([[0.0], kept[1:]])
    for rows in _blocks(num_frames):
        found = np.zeros((rows.stop - rows.start, count, len(body.tree.marker_names), 3))
        for row, own in enumerate(left[rows]):
            noise = float(errors.shift_scale) * np.sqrt(1 - own**2) * rng.standard_normal(now.shape)
            found[row][:, unseen] = now = own * now + noise
        yield found


def _places_of(body: SeenBody, drawn: _Drawn) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Places (T, N, K, 3) of a block of frames, mm, and where the cameras see them (T, N, C, K, 2)."""
    single = np.float32
    frames, count, width = drawn.poses.shape
    own, per_length = MarkerKinematics.of(body.tree), body.inputs.errors.per_length
    if per_length is not None:
        parts = (own.offsets, per_length.offsets), (own.marker_offsets, per_length.marker_offsets)
        own_offsets: Any = [base + np.tensordot(drawn.lengths, np.asarray(each, np.float64), 1) for base, each in parts]
        own = own.with_offsets(*(np.tile(each.astype(single), (frames, 1, 1)) for each in own_offsets))
    poses = drawn.poses.reshape(-1, width).astype(single)
    markers = own.places(poses).reshape(frames, count, -1, 3) + drawn.shifts.astype(single)
    errors = drawn.errors if drawn.errors.size else None
    points = np.moveaxis(points_of_erring_cameras(body.cameras, markers, errors), 0, 2)
    return markers.astype(single), points.astype(single)


def _blocks(num_frames: int) -> Iterator[slice]:
    return (slice(first, min(first + _FRAMES, num_frames)) for first in range(0, num_frames, _FRAMES))
