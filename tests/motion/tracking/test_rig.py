"""A motion as a rig: what is written puts the joints where the body has them, in the unit and under the names asked for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from drawn_bodies import drawn_result
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.errors import InputError
from poseppl.motion.io.bvh import read_bvh
from poseppl.motion.tracking.rig import write_rig

FRAMES = 6


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    body = full_body()
    rng = np.random.default_rng(1)
    return body.rest + np.where(np.arange(len(body.rest)) < 3, 200.0, 0.5) * rng.normal(size=(FRAMES, len(body.rest)))


@pytest.mark.parametrize(
    ("rig", "unit", "scale", "knee", "head"),
    [
        ("poseppl", "mm", 1.0, "knee_l", "head"),
        ("mixamo", "cm", 10.0, "LeftLeg", "Head"),
        ("blender", "m", 1000.0, "shin.L", "spine.006"),
    ],
)
def test_joints_are_where_the_body_has_them(
    tmp_path: Path, poses: np.ndarray, rig: str, unit: str, scale: float, knee: str, head: str
) -> None:
    body = full_body()
    tree = drawn_result(poses, np.full(poses.shape[1], 1e-6), np.arange(0, 2 * FRAMES, 2), 25.0, num_draws=3)
    write_rig(tmp_path / "r.bvh", tree, rig, unit)  # type: ignore[arg-type]
    found = read_bvh(tmp_path / "r.bvh", scale=scale, up="y")
    assert found.rate == 25.0
    plain = [name.split(":")[-1] for name in found.names]
    places = body.places(poses)
    for name, marker in ((knee, "knee_l"), (head, "neck")):
        np.testing.assert_allclose(
            found.positions[:, plain.index(name)], places[:, body.tree.marker_names.index(marker)], atol=0.1
        )
    wrist = places[:, body.tree.marker_names.index("wrist_r")]
    assert min(np.abs(found.positions[:, k] - wrist).max() for k, name in enumerate(plain) if "_end" in name) < 0.1


def test_what_nobody_saw_is_named_so(tmp_path: Path, poses: np.ndarray) -> None:
    tree = drawn_result(poses, np.full(poses.shape[1], 1e-6), np.arange(FRAMES), 25.0, num_draws=3)
    tree.attrs["unseen"] = json.dumps({"markers": ["skull", "crown"], "coordinates": ["head.Z", "head.Y", "head.X"]})
    write_rig(tmp_path / "r.bvh", tree)
    assert "mixamorig:Head_unseen" in (tmp_path / "r.bvh").read_text()
    with pytest.raises(InputError, match="unit: 'inch' .expected mm, cm, m"):
        write_rig(tmp_path / "r.bvh", tree, "mixamo", "inch")
