"""Results of several runs on the same data, with known answers: Gaussian posteriors seen through autoregressive chains."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from synthetic import autoregression

from poseppl.motion.tracking.body_result import BodyNames, body_result

DOFS = ("root.tx", "root.Z", "knee<b>.X")
MARKERS = ("pelvis", "knee", "ankle")


def scene(num_frames: int = 40, seed: int = 0) -> dict[str, np.ndarray]:
    """Centres of the posterior (frame, state_dim), a truth drawn from it, markers, and points of one camera."""
    rng = np.random.default_rng(seed)
    centre = rng.standard_normal((num_frames, len(DOFS))).cumsum(axis=0)
    state = centre + rng.standard_normal(centre.shape)
    markers = 100.0 * state[:, :, None] + np.arange(3)
    points = rng.standard_normal((num_frames, 1, len(MARKERS), 2))
    points[num_frames // 2, 0, 2] = np.nan
    return {"centre": centre, "state": state, "markers": markers, "points": points}


def run_on(
    data: dict[str, np.ndarray],
    *,
    seed: int = 0,
    method: str = "hmc",
    rho: float = 0.0,
    shape: tuple[int, int] = (4, 50),
    seconds: float = 0.1,
    evaluations: tuple[int, int] = (100, 300),
    shift: float = 0.0,
    with_truth: bool = True,
    weighted: float | None = None,
    **attrs: Any,
) -> xr.DataTree:
    """One run: chains of unit variance around the centre, or particles with an effective number ``weighted``."""
    frames, dofs = data["centre"].shape
    chains, draws = shape if weighted is None else (1, shape[0] * shape[1])
    state = data["centre"] + shift + autoregression(np.random.default_rng(seed), (chains, draws, frames, dofs), rho)
    stats = {
        "acceptance_rate": np.full(frames, 0.8 if weighted is None else np.nan),
        "ess": np.full(frames, np.nan if weighted is None else weighted),
        "num_likelihood": np.full(frames, evaluations[0]),
        "num_gradient": np.full(frames, evaluations[1]),
        "failed": np.zeros(frames, bool),
    }
    return body_result(
        state=state,
        names=BodyNames(DOFS, MARKERS, ("front",)),
        extras={"markers": 100.0 * state[..., None] + np.arange(3)},
        sample_stats=stats,
        observed={"points": data["points"]},
        truth={"state": data["state"], "markers": data["markers"]} if with_truth else None,
        num_particles=None if weighted is None else 1000,
        attrs={
            "model": "body",
            "filter": method,
            "settings": {"shape": list(shape)},
            "seed": seed,
            "wall_seconds": seconds * frames,
            "frames_run": frames,
        }
        | attrs,
    )
