"""Results with known answers: Gaussian autoregressive chains of known inefficiency around a walking stick figure."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.stats import norm

from poseppl.motion.tracking.body_result import BodyNames, body_result
from poseppl.runs.predictive import DataPrediction, Prediction, StatePrediction

MARKERS = (
    ("pelvis", (0, 0, 950), None),
    ("chest", (0, 0, 1350), "pelvis"),
    ("head", (0, 0, 1700), "chest"),
    ("shoulder_l", (-180, 0, 1400), "chest"),
    ("elbow_l", (-230, 0, 1120), "shoulder_l"),
    ("wrist_l", (-240, 0, 870), "elbow_l"),
    ("shoulder_r", (180, 0, 1400), "chest"),
    ("elbow_r", (230, 0, 1120), "shoulder_r"),
    ("wrist_r", (240, 0, 870), "elbow_r"),
    ("hip_l", (-100, 0, 900), "pelvis"),
    ("knee_l", (-110, 0, 480), "hip_l"),
    ("ankle_l", (-110, 0, 70), "knee_l"),
    ("hip_r", (100, 0, 900), "pelvis"),
    ("knee_r", (110, 0, 480), "hip_r"),
    ("ankle_r", (110, 0, 70), "knee_r"),
)
NAMES = tuple(name for name, _, _ in MARKERS)
EDGES = np.array([(NAMES.index(parent), i) for i, (_, _, parent) in enumerate(MARKERS) if parent])
DOFS = ("root.tx", "root.ty", "root.tz", "hip_l.X", "knee_l.X", "hip_r.X", "knee_r.X", "<script>alert(1)</script>")


def autoregression(
    rng: np.random.Generator, shape: tuple[int, ...], rho: float | np.ndarray, *, draw_axis: int = 1
) -> np.ndarray:
    """Stationary AR(1) chains of unit variance along ``draw_axis``; their inefficiency is (1 + rho) / (1 - rho)."""
    noise = np.moveaxis(rng.standard_normal(shape), draw_axis, 0)
    chain = np.empty_like(noise)
    chain[0] = noise[0]
    for i in range(1, len(noise)):
        chain[i] = rho * chain[i - 1] + np.sqrt(1 - np.square(rho)) * noise[i]
    return np.moveaxis(chain, 0, draw_axis)


def walk(num_frames: int) -> np.ndarray:
    """Markers of a stick figure walking along X, (frame, marker, axis) in mm."""
    rest = np.array([place for _, place, _ in MARKERS], float)[:, [1, 0, 2]]
    phase = 2 * np.pi * np.arange(num_frames)[:, None] / 30
    swing = np.array([(-1 if name.endswith("_l") else 1) * (1400 - z) / 2.2 for name, (_, _, z), _ in MARKERS])
    swing[:3] = 0
    swing[3:9] *= -0.4
    path = np.broadcast_to(rest, (num_frames, *rest.shape)).copy()
    path[:, :, 0] += np.sin(phase) * swing + 40.0 * np.arange(num_frames)[:, None]
    return path


def project(points: np.ndarray) -> np.ndarray:
    """One paper camera 5 m in front, (..., marker, axis) to (..., camera, marker, xy)."""
    depth = points[..., 1] + 5000.0
    return np.stack([points[..., 0] / depth, (points[..., 2] - 1000) / depth], axis=-1)[..., None, :, :]


def synthetic_result(
    *,
    seed: int = 0,
    num_frames: int = 24,
    num_chains: int = 4,
    num_draws: int = 40,
    rho: float = 0.3,
    weighted: bool = False,
    with_truth: bool = True,
    truth_scale: float = 1.0,
    sample_stats: dict[str, np.ndarray] | None = None,
) -> xr.DataTree:
    """A result whose posterior is Gaussian, whose truth is a draw from it (spread by ``truth_scale``)."""
    rng = np.random.default_rng(seed)
    if weighted:
        num_chains, rho = 1, 0.0
    scale = np.array([20.0, 60.0, 20.0] + [0.1] * (len(DOFS) - 3))
    centre = np.concatenate([walk(num_frames)[:, 0], 0.4 * np.sin(np.arange(num_frames)[:, None] / 5 + np.arange(5))], axis=1)
    noise = autoregression(rng, (num_chains, num_draws, num_frames, len(DOFS)), rho)
    true_noise = truth_scale * rng.standard_normal((num_frames, len(DOFS)))
    swing = 100.0 * np.linspace(0.2, 1.0, len(MARKERS))[:, None]

    def markers(z: np.ndarray) -> np.ndarray:
        shift = scale[:3] * z[..., :3]
        return walk(num_frames) + shift[..., None, :] + swing * 0.3 * z[..., 3:6][..., None, :]

    body, true_body = markers(noise), markers(true_noise)
    observed = project(true_body) + 0.003 * rng.standard_normal((num_frames, 1, len(MARKERS), 2))
    observed[num_frames // 2, :, 3:5] = np.nan
    stats = {
        "log_evidence": rng.normal(60.0, 3.0, num_frames),
        "ess": np.full(num_frames, 800.0) if weighted else np.full(num_frames, np.nan),
        "acceptance_rate": np.full(num_frames, np.nan) if weighted else rng.uniform(0.8, 0.9, num_frames),
        "divergences": np.zeros(num_frames, np.int32),
        "num_likelihood": np.full(num_frames, 5000),
        "num_gradient": np.full(num_frames, 0 if weighted else 5000),
        "step_size": np.full(num_frames, 0.2),
        "failed": np.zeros(num_frames, bool),
    }
    if weighted:
        stats["unique_ancestors"] = np.full(num_frames, 700)
    return body_result(
        state=(centre + scale * noise).astype(np.float32),
        names=BodyNames(DOFS, NAMES, ("front",)),
        extras={"markers": body.astype(np.float32), "points": project(body).astype(np.float32)},
        sample_stats=stats | (sample_stats or {}),
        observed={"points": observed},
        truth={"state": centre + scale * true_noise, "markers": true_body} if with_truth else None,
        cameras={"centre": np.array([[0.0, -5000.0, 1000.0]]), "focal": np.array([[1.0, -1.0]]), "distortion": None},
        edges=EDGES,
        root="pelvis",
        rate=30.0,
        frames=np.arange(10, 10 + num_frames),
        num_particles=1000 if weighted else None,
        attrs={
            "model": "poseppl_models.synthetic:stick",
            "filter": "particle filter" if weighted else "hmc filter",
            "settings": {"num_chains": num_chains, "num_updates": num_draws, "note": "<b>not bold</b>"},
            "seed": seed,
            "versions": {"jax": "0.10.2", "numpy": np.__version__},
            "wall_seconds": 2.5,
            "compile_seconds": 1.2,
            "input": "built-in walk",
        },
    )


def predicted_result(transform: np.ndarray) -> xr.DataTree:
    """A result with predictive checks, whose probability integral transforms (frame, entry) are these."""
    tree = synthetic_result(num_frames=len(transform))
    one, whole = np.ones_like(transform), np.ones(len(transform))
    checks = DataPrediction(transform, norm.ppf(transform), one / 2, one / 2, whole, whole / 2)
    dims = ("frame", "entry")
    values = {name: (dims[: value.ndim], value) for name, value in checks._asdict().items() if value is not None}
    tree["predictive"] = xr.DataTree(xr.Dataset(values))
    return tree


def checks_of_state(state: StatePrediction | None, num_frames: int) -> dict[str, np.ndarray]:
    """Predictive checks of a result's state, whose data say nothing."""
    unseen = DataPrediction(*[np.full((num_frames, 1), np.nan)] * 4, *[np.full(num_frames, np.nan)] * 2)
    return Prediction(unseen, state).by_name()


def two_sided_result() -> xr.DataTree:
    """A result whose right arm leans the other way in a quarter of the draws of frames 16 to 19: its wrist is 500 mm away."""
    tree = synthetic_result(num_frames=12)
    markers = tree["posterior/markers"]
    other = np.arange(markers.sizes["draw"]) % 4 == 0
    for name, away in (("elbow_r", 250.0), ("wrist_r", 500.0)):
        markers.values[:, other, 6:10, NAMES.index(name), 1] += away
    return tree
