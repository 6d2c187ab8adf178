"""OpenSim reads what we export, and its inverse kinematics of our joints gives our angles."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_bodies import drawn_result
from poseppl_models.bodies.choo_fleet import full_body
from waiting import PATIENCE

from poseppl.motion.io.opensim_files import read_mot
from poseppl.motion.tracking.export import export

SCRIPT = Path(__file__).parents[1] / "io" / "opensim_reading.py"
FRAMES = np.arange(6, 24, 3)
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A person who moves all limbs, known to a fifth of a degree; the girdle, which OpenSim's bodies lack, is still."""
    pytest.importorskip("opensim")
    body, rng = full_body(), np.random.default_rng(5)
    names = body.tree.coordinate_names
    first, last = (np.asarray(body.rest) + rng.uniform(-0.5, 0.5, len(names)) for _ in range(2))
    share = np.linspace(0.0, 1.0, len(FRAMES))[:, None]
    poses = (1 - share) * first + share * last
    for index, name in enumerate(names):
        joint, _, axis = name.partition(".")
        if joint == "girdle":
            poses[:, index] = 0.0
        elif joint.startswith(("knee", "elbow")):  # bent, so that the turn of the limb above is seen
            poses[:, index] = (-1 if joint.startswith("knee") else 1) * (0.8 + 0.4 * share[:, 0])
        elif axis.startswith("t"):
            poses[:, index] *= 100.0
    tree = drawn_result(poses, np.where(np.arange(len(names)) < 3, 1.0, 0.003), FRAMES, 20.0)
    place = tmp_path_factory.mktemp("opensim")
    export(tree, place, "walk", ("trc", "mot", "osim"))
    (place / "lengths.json").write_text(json.dumps(dict(body.lengths)))
    return place


@pytest.fixture(scope="module")
def read(folder: Path) -> dict[str, Any]:
    arguments = ["walk", "lengths.json", "read.json"]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, Any] = json.loads((folder / "read.json").read_text())
    return found


def test_opensim_reads_the_places(folder: Path, read: dict[str, Any]) -> None:
    written = np.loadtxt(folder / "walk.trc", skiprows=6)
    assert (read["units"], read["rate"]) == ("millimeters", 20.0)
    np.testing.assert_allclose(read["times"], FRAMES / 60.0, atol=1e-8)
    places = np.stack([read["places"][name] for name in full_body().tree.marker_names], 1)
    np.testing.assert_array_equal(places.reshape(len(FRAMES), -1), written[:, 2:])


def test_opensim_reads_the_angles(folder: Path, read: dict[str, Any]) -> None:
    written = read_mot(folder / "walk.mot")
    assert read["in_degrees"]
    assert set(read["angles"]) == {"time", *written.columns}
    for name, values in written.columns.items():
        np.testing.assert_allclose(read["angles"][name], values, rtol=1e-12, err_msg=name)


def test_inverse_kinematics_finds_our_angles(folder: Path, read: dict[str, Any]) -> None:
    """The means of draws that are 0.2 degrees wide bend lengths by less than a mm: half a degree is left for that."""
    ours, theirs = read_mot(folder / "walk.mot"), read["found"]
    np.testing.assert_allclose(theirs["time"], FRAMES / 60.0, atol=1e-6)
    compared = [name for name in ours.columns if not name.startswith(("head", "girdle"))]
    assert len(compared) == 25
    for name in compared:
        known = -np.asarray(theirs[name.replace("angle", "bend")]) if name.startswith("knee") else np.asarray(theirs[name])
        bound = 1e-3 if name.startswith("pelvis_t") and name[-1] in "xyz" and len(name) == 9 else 0.5
        np.testing.assert_allclose(ours.columns[name], known, atol=bound, err_msg=name)


def test_inverse_kinematics_with_our_model_finds_our_angles(folder: Path, read: dict[str, Any]) -> None:
    """The model that is written beside the angles has their coordinates, signs and units; bounds as above."""
    ours, theirs = read_mot(folder / "walk.mot"), read["found with ours"]
    compared = [name for name in ours.columns if not name.startswith(("head", "girdle"))]
    assert set(theirs) == {"time", *compared}
    for name in compared:
        off = np.asarray(theirs[name]) - ours.columns[name]
        place = name in ("pelvis_tx", "pelvis_ty", "pelvis_tz")
        bound = 1e-3 if place else 0.5
        assert np.abs(off if place else (off + 180) % 360 - 180).max() < bound, name
