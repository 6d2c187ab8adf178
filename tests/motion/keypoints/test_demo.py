"""The demo recording: the same for the same seed, never over other files, and with the faults that it promises."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.geometry import project
from poseppl.motion.io import read_cameras, read_keypoints
from poseppl.motion.io.keypoint_layouts import markers_of_names
from poseppl.motion.io.opensim_files import read_mot
from poseppl.motion.io.trc import read_trc
from poseppl.motion.keypoints.demo import demo_walk, write_demo
from poseppl.motion.tracking.placing import cameras_of_records


def test_nothing_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="there are files already.*nothing is replaced"):
        write_demo(tmp_path)
    with pytest.raises(InputError, match="seconds: 0.1"):
        write_demo(tmp_path / "new", seconds=0.1)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    place = tmp_path_factory.mktemp("demo")
    return [
        write_demo(place / name, seconds=1.0, seed=seed)["camera_1"].parent for name, seed in (("a", 3), ("b", 3), ("c", 4))
    ]


@pytest.mark.full
def test_the_same_seed_writes_the_same_files(folders: list[Path]) -> None:
    first, again, other = ({path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")} for folder in folders)
    assert first == again and set(first) == set(other)
    assert {path for path in first if first[path] == other[path]} == {Path("Calib.toml"), Path("truth.trc"), Path("truth.mot")}


@pytest.mark.full
def test_points_are_near_the_truth_but_for_their_faults(folders: list[Path]) -> None:
    folder = folders[0]
    truth = read_trc(folder / "truth.trc", up="y")
    cameras = cameras_of_records(read_cameras(folder / "Calib.toml"))
    exact = np.asarray(project(cameras, jnp.asarray(truth.positions, float)))
    missing = []
    for number, images in enumerate(exact):
        found = read_keypoints(folder / f"camera_{number + 1}")
        assert found.layout == "body25" and found.points.shape[0] == 60
        into = {name: k for name, k in markers_of_names(found.names).items() if name in truth.names}
        assert {"heel_l", "small_toe_r", "nose", "ear_l"} <= set(into)
        points = found.points[:, 0, list(into.values())]
        off = np.linalg.norm(points - images[:, [truth.names.index(name) for name in into]], axis=-1)
        assert np.nanmedian(off) < 30.0  # a camera is turned by 1/3 degree about each axis (6 px, SD), and noise
        missing.append(np.isnan(off).mean())
    assert 0.01 < np.mean(missing) < 0.15
    angles = read_mot(folder / "truth.mot")
    assert angles.in_degrees and {"ankle_angle_r", "knee_angle_l", "pelvis_tx"} <= set(angles.columns)


@pytest.mark.full
def test_feet_that_stand_are_level() -> None:
    """Heels and toes are about as high in stance, and heels are lifted in swing."""
    subject = demo_walk(3.0, 60.0)
    places = dict(zip(subject.body.tree.marker_names, np.moveaxis(subject.markers, 1, 0), strict=True))
    for side in "lr":
        heel, toe = places[f"heel_{side}"], places[f"big_toe_{side}"]
        standing = np.abs(np.gradient(heel[:, 0]) * 60) < 200.0  # mm a second
        assert 0.3 < standing.mean() < 0.7
        assert np.median(np.abs(heel[standing, 2] - toe[standing, 2])) < 60.0
        swinging = np.abs(np.gradient(toe[:, 0]) * 60) > 1000.0
        assert heel[swinging, 2].mean() > heel[standing, 2].mean() + 60.0
