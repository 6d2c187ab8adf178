"""Results made by hand: residuals, steps and silhouettes of a chosen size, and runs of a Kalman filter on a random walk."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.cli.options import as_option
from poseppl.diagnostics.verdicts import verdicts
from poseppl.motion.tracking.body_result import BodyNames, body_result

DOFS = ("root.tx", "root.ty", "hip.X", "knee.X", "neck.Z")
MARKERS = ("head", "knee", "ankle", "wrist")
CAMERAS = ("front", "side")


def unit(rng: np.random.Generator, shape: tuple[int, ...], axes: tuple[int, ...]) -> np.ndarray:
    """Uniform numbers around 0, none far out, whose mean square over the axes is 1, exactly."""
    numbers = rng.uniform(-1, 1, shape)
    return numbers / np.sqrt(np.mean(numbers**2, axis=axes, keepdims=True))


def points_tree(
    scale: np.ndarray | float = 1.0, *, shift: np.ndarray | float = 0.0, informed: float = 0.4, frames: int = 30
) -> xr.DataTree:
    """Residuals of chosen scales (camera, marker), and means ``shift`` (camera, marker, xy) in units of the noise.

    Args:
        scale: Scales, by camera and marker.
        shift: Added to all frames.
        informed: Share of the noise's variance that the projection's is.
        frames: How many.
    """
    rng = np.random.default_rng(1)
    shape = (frames, len(CAMERAS), len(MARKERS), 2)
    noise = rng.uniform(2.0, 5.0, shape[1:3])
    mean = rng.uniform(100.0, 900.0, shape)
    numbers = unit(rng, shape, (0, 3)) * np.broadcast_to(scale, shape[1:3])[..., None]
    observed = mean + noise[..., None] * (np.sqrt(1 - informed) * numbers + shift)
    return body_result(
        state=rng.standard_normal((2, 10, frames, len(DOFS))),
        names=BodyNames(DOFS, MARKERS, CAMERAS),
        summary={"points_mean": mean, "points_sd": np.sqrt(informed) * noise[..., None] * np.ones(shape)},
        extras={"points": mean + np.zeros((2, 10, 1, 1, 1, 1))},
        observed={"points": observed},
        inputs={"noise": noise},
        frames=np.arange(7, 7 + frames),
    )


def steps_tree(
    scale: np.ndarray | float = 1.0, *, leaps: int = 0, leap: float = 5.5, frames: int = 51, smoother: bool = False
) -> xr.DataTree:
    """Steps of chosen scales (state_dim,), in units of a walk that is never the same, and so many of the knee's far larger."""
    rng = np.random.default_rng(2)
    walk = rng.uniform(0.1, 3.0, (frames, len(DOFS)))
    steps = unit(rng, (frames - 1, len(DOFS)), (0,)) * np.broadcast_to(scale, len(DOFS))
    steps[:leaps, 3] = leap - 0.1 * np.arange(leaps)
    mean = np.concatenate([[[4.0, -3.0, 2.0, 1.0, 0.5]], walk[1:] * steps]).cumsum(0)
    return body_result(
        state=mean + rng.standard_normal((2, 10, frames, len(DOFS))),
        names=BodyNames(DOFS),
        summary={"state_mean": mean, "state_sd": np.full(mean.shape, 0.05)},
        inputs={"step_scale": walk},
        frames=np.arange(7, 7 + frames),
        attrs={"smoother": "trajectory"} if smoother else {},
    )


def drawn_tree(wide: float, *, leap: float = 0.0, num_draws: int = 1000, frames: int = 51) -> xr.DataTree:
    """Means of draws of a closed form's posterior, `wide` steps of the walk wide; the knee's last step is larger by a leap."""
    rng = np.random.default_rng(5)
    walk = rng.uniform(0.1, 3.0, len(DOFS))
    mean = walk * wide * rng.standard_normal((frames, len(DOFS))) / np.sqrt(num_draws)
    mean[-1, 3] += leap * walk[3]
    return body_result(
        state=mean + wide * walk * rng.standard_normal((2, 10, frames, len(DOFS))),
        names=BodyNames(DOFS),
        summary={"state_mean": mean, "state_sd": wide * walk * np.ones(mean.shape)},
        sample_stats={"ess": np.full(frames, float(num_draws))},
        inputs={"step_scale": walk * np.ones(mean.shape)},
        frames=np.arange(7, 7 + frames),
        attrs={"closed form": True},
    )


def silhouettes_tree(
    overlap: np.ndarray | None = None, area: np.ndarray | None = None, centre: np.ndarray | None = None, rate: float = 30.0
) -> xr.DataTree:
    """Twelve frames of silhouettes in two cameras."""
    rng = np.random.default_rng(3)
    frames = 12
    area = 40_000 * rng.uniform(0.95, 1.05, (frames, 2)) if area is None else area
    centre = rng.uniform(300.0, 310.0, (frames, 2, 2)) if centre is None else centre
    return body_result(
        state=rng.standard_normal((2, 10, frames, len(DOFS))),
        names=BodyNames(DOFS, MARKERS, CAMERAS),
        sample_stats={"overlap": rng.uniform(0.8, 0.9, (frames, 2)) if overlap is None else overlap},
        observed={
            "points": np.full((frames, 2, len(MARKERS), 2), np.nan),
            "silhouette_area": area,
            "silhouette_centre": centre,
        },
        cameras={"scale": np.array([0.5, 0.25])},
        frames=np.arange(7, 7 + frames),
        rate=rate,
    )


def kalman_tree(
    *, noise: np.ndarray | float = 3.0, told: np.ndarray | float = 3.0, walk: float = 1.0, told_walk: float = 1.0
) -> xr.DataTree:
    """A Kalman filter on points that a random walk's coordinates move linearly, with a noise and a walk that may be wrong.

    Args:
        noise: Noise of the points, by camera and marker.
        told: The filter's value of it.
        walk: Standard deviation of the coordinates' steps.
        told_walk: The filter's value of it.
    """
    rng = np.random.default_rng(4)
    frames, dofs, shape = 400, len(DOFS), (len(CAMERAS), len(MARKERS), 2)
    design = rng.standard_normal((np.prod(shape), dofs))
    state = np.cumsum(walk * rng.standard_normal((frames, dofs)), 0)
    noises, tolds = (np.broadcast_to(each, shape[:2]) for each in (noise, told))
    told_variance = np.diag(np.repeat(tolds.ravel() ** 2, 2))
    data = state @ design.T + np.repeat(noises.ravel(), 2) * rng.standard_normal((frames, len(design)))
    mean, covariance = np.zeros(dofs), np.zeros((dofs, dofs))
    means, covariances = [], []
    for seen in data:
        predicted = covariance + told_walk**2 * np.eye(dofs)
        gain = predicted @ design.T @ np.linalg.inv(design @ predicted @ design.T + told_variance)
        mean, covariance = mean + gain @ (seen - design @ mean), predicted - gain @ design @ predicted
        means.append(mean)
        covariances.append(covariance)
    spread = np.sqrt([np.diag(each) for each in covariances])
    width = np.sqrt([np.diag(design @ each @ design.T) for each in covariances])
    projected = (np.array(means) @ design.T).reshape(frames, *shape)
    return body_result(
        state=np.array(means) + spread * rng.standard_normal((2, 10, frames, dofs)),
        names=BodyNames(DOFS, MARKERS, CAMERAS),
        summary={
            "state_mean": np.array(means),
            "state_sd": spread,
            "points_mean": projected,
            "points_sd": width.reshape(frames, *shape),
        },
        extras={"points": projected + np.zeros((2, 10, 1, 1, 1, 1))},
        observed={"points": data.reshape(frames, *shape)},
        inputs={"noise": tolds, "step_scale": np.full((frames, dofs), told_walk)},
    )


def texts(tree: xr.DataTree) -> str:
    """All verdicts, a line each, as the command line words them."""
    return "\n".join(f"{verdict.severity}: {verdict.worded(as_option)}" for verdict in verdicts(tree))
