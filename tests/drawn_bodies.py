"""Results of a body whose poses are drawn around a known one, without a tracker."""

from __future__ import annotations

import numpy as np
import xarray as xr
from poseppl_models.bodies.choo_fleet import arm, full_body

from poseppl.motion.tracking.body_result import BodyNames, body_result

BUILDERS = {"full_body": full_body, "arm": arm}


def drawn_result(
    poses: np.ndarray,
    scale: np.ndarray,
    frames: np.ndarray,
    rate: float | None,
    *,
    body_name: str = "full_body",
    num_draws: int = 200,
) -> xr.DataTree:
    """A result of independent Gaussian draws.

    Args:
        poses: (T, d) means.
        scale: (d,) standard deviations, mm and radians.
        frames: (T,) numbers.
        rate: Frames a second.
        body_name: A builder of poseppl_models.bodies.choo_fleet.
        num_draws: Number of draws of each frame.
    """
    body, rng = BUILDERS[body_name](), np.random.default_rng(3)
    free = list(body.free_coordinates)
    states = np.tile(poses, (num_draws, 1, 1))
    states[..., free] += (scale * rng.normal(size=states.shape))[..., free]
    markers = np.stack([body.places(each) for each in states])
    return body_result(
        state=states[None][..., free],
        names=BodyNames([body.tree.coordinate_names[i] for i in free], body.tree.marker_names),
        extras={"markers": markers[None]},
        inputs=None if body.free is None else {"states": poses},
        frames=frames,
        rate=rate,
        attrs={
            "model": f"poseppl_models.bodies.choo_fleet:{body_name}",
            "lengths": dict(body.lengths),
            "settings": {},
            "input": "made",
        },
    )
