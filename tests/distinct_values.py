"""A result in which every figure is another one, so that none can stand for its neighbour."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.motion.tracking.body_result import BodyNames, body_result

NUM_FRAMES = 6
SHARES = {"coverage": (0.41, 0.62, 0.83), "coverage_markers": (0.31, 0.52, 0.73)}
ERRORS = {"coverage": (0.011, 0.013, 0.017), "coverage_markers": (0.019, 0.021, 0.023)}


def distinct_result() -> xr.DataTree:
    """Three coordinates, three markers of which the last is the root, two cameras; 2.5 s for 5 of its 6 frames."""
    rng = np.random.default_rng(0)
    state = rng.normal(size=(2, 8, NUM_FRAMES, 3))
    markers = rng.normal(0.0, 100.0, (2, 8, NUM_FRAMES, 3, 3))
    frames = np.arange(NUM_FRAMES)
    tree = body_result(
        state=state,
        names=BodyNames(("root.tx", "root.Z", "knee.X"), ("knee", "ankle", "pelvis"), ("front", "side")),
        extras={"markers": markers},
        sample_stats={"failed": frames < 2, "acceptance_rate": np.full(NUM_FRAMES, 0.64)},
        truth={
            "state": state.mean((0, 1)),
            "markers": markers.mean((0, 1)) + [[3.0, 4.0, 0.0], [0.0, 0.0, 12.0], [0.0, 7.0, 0.0]],
        },
        cameras={"centre": np.zeros((2, 3)), "focal": np.array([[1.0, -1.0], [1500.0, 1400.0]])},
        root="pelvis",
        rate=25.0,
        frames=10 + frames,
        attrs={
            "model": "body:stick",
            "filter": "hmc",
            "input": "WALK",
            "settings": {},
            "wall_seconds": 2.5,
            "compile_seconds": 1.5,
            "frames_run": 5,
        },
    )
    grid, level = ("frame", "state_dim"), ("level",)
    data = {
        "joint_error": (("frame", "marker"), 10.0 * (frames[:, None] + [1, 2, 6])),
        "joint_error_relative": (("frame", "marker"), 2.0 * (frames[:, None] + [1, 3, 5])),
        "rejection_rate": (("frame",), np.full(NUM_FRAMES, 0.36)),
        "tau": (grid, np.broadcast_to([1.0, 4.0, 19.0], (NUM_FRAMES, 3))),
        "tau_windowed": (grid, np.full((NUM_FRAMES, 3), 2.2)),
        "ess": (grid, np.full((NUM_FRAMES, 3), 77.0)),
        "rhat": (grid, np.full((NUM_FRAMES, 3), 1.02)),
        **{name: (level, np.array(shares)) for name, shares in SHARES.items()},
        **{f"{name}_se": (level, np.array(errors)) for name, errors in ERRORS.items()},
    }
    tree["diagnostics"] = xr.DataTree(
        xr.Dataset(
            data,
            coords={
                "level": [0.5, 0.8, 0.9],
                "marker": ["knee", "ankle", "pelvis"],
                "state_dim": ["root.tx", "root.Z", "knee.X"],
            },
        )
    )
    return tree
