"""`poseppl simulate --video`."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from poseppl.cli import main
from poseppl.motion.io import read_cameras, read_masks, read_places
from poseppl.motion.rendering import Setting, render
from poseppl.motion.silhouettes.video_sources import read_scene_truth

pytestmark = pytest.mark.usefixtures("here")

SMALL = ["simulate", "--video", "--size", "96", "72"]


@pytest.mark.full
def test_a_recording_becomes_a_scene(
    drawable: Callable[..., Setting], data_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = data_dir / "cmu_amc"
    recording = [str(folder / "02_01.amc"), "--skeleton", str(folder / "02.asf"), "--frames", "40:300:120"]
    assert main([*SMALL, *recording, "--cameras", "3", "--noise", "0.02", "--seed", "5"]) == 0
    printed = capsys.readouterr().out
    assert "poseppl-02_01" in printed and "3 at 1 Hz" in printed and "table" in printed
    scene = Path("poseppl-02_01")
    assert len(read_cameras(scene / "Calib.toml")) == 3
    with xr.open_datatree(scene / "truth.nc", engine="h5netcdf") as truth:
        markers = truth["truth"]["markers"]
        frames, places = read_places(scene / "truth.csv", markers["marker"].values.tolist())
        assert frames.tolist() == markers["frame"].values.tolist() == [40, 160, 280]
        assert np.array_equal(places, markers.values)
    for camera in (1, 2, 3):
        assert read_masks(scene / f"camera_{camera}_visible.npz").any(axis=(1, 2)).all()


@pytest.mark.full
def test_a_recording_is_filmed_along_a_circle(drawable: Callable[..., Setting], data_dir: Path) -> None:
    folder = data_dir / "cmu_amc"
    recording = [str(folder / "02_01.amc"), "--skeleton", str(folder / "02.asf"), "--frames", "0:300:60", "--no-clutter"]
    for name, turn in (("straight", []), ("circle", ["--turn", "-1000"])):
        assert main([*SMALL, *recording, "--cameras", "1", "-q", "-o", name, *turn]) == 0
    straight, circle = (read_scene_truth(f"{name}/truth.nc") for name in ("straight", "circle"))
    assert np.abs(circle.states[:, 6:] - straight.states[:, 6:]).max() < 0.1
    turn = circle.states[:, 3] - straight.states[:, 3]
    assert np.all(np.diff(turn) < 0) and turn[-1] < -1.0
    assert read_masks("circle/camera_1_visible.npz").any(axis=(1, 2)).all()


@pytest.mark.full
def test_the_built_in_walk_without_clutter(drawable: Callable[..., Setting]) -> None:
    assert main([*SMALL, "--frames", "0:2", "--no-clutter", "--cameras", "1", "-o", "walk", "-q"]) == 0
    assert sorted(path.name for path in Path().iterdir()) == ["walk"]
    assert np.array_equal(read_masks("walk/camera_1_visible.npz"), read_masks("walk/camera_1_whole.npz"))


@pytest.mark.full
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--video", "--view", "0"], "--view"),
        (["--video", "--camera", "a.toml"], "--camera"),
        (["--video", "--missing", "0.1"], "--missing"),
        (["--video", "--noise", "-1"], "--noise"),
        (["--video", "--size", "95", "72", "--frames", "0:1"], "--size"),
        (["--video", "--cameras", "5", "--frames", "0:1"], "--cameras"),
        (["--video", "--turn", "10"], "--turn"),
        (["--video", "-o", "absent/scene"], "does not exist"),
        (["--video", "-o", "."], "exists"),
        (["--clutter"], "--clutter"),
        (["--lossless"], "--lossless"),
    ],
)
def test_options_that_do_not_go_together(capsys: pytest.CaptureFixture[str], arguments: list[str], words: str) -> None:
    assert main(["simulate", *arguments]) == 1
    message = capsys.readouterr().err
    assert words in message and len(message.strip().splitlines()) == 1
    assert not list(Path().iterdir())


def test_a_missing_package_says_how_to_install_it(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for package, extra in (("mujoco", "render"), ("cv2", "vision")):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            assert main([*SMALL, "--frames", "0:1"]) == 1
        assert f"pip install 'poseppl[{extra}]'" in capsys.readouterr().err
    assert not list(Path().iterdir())


@pytest.mark.full
def test_a_missing_opengl_says_which_packages_are_wanted() -> None:
    """With a setting for another platform's OpenGL, MuJoCo has none to draw with."""
    code = "import sys; from poseppl.cli import main; sys.exit(main())"
    environment = {**os.environ, "MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "none"}
    command = [sys.executable, "-c", code, *SMALL, "--frames", "0:1"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    for words in ("MUJOCO_GL being egl", "libegl1", "libgl1"):
        assert words in done.stderr
    assert "Traceback" not in done.stderr and not list(Path().iterdir())


@pytest.mark.full
def test_rendering_without_a_screen_is_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render.importlib, "import_module", lambda name: name)
    monkeypatch.setattr(render.sys, "platform", "linux")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    render.load_mujoco()
    assert os.environ["MUJOCO_GL"] == "egl"
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    render.load_mujoco()
    assert os.environ["MUJOCO_GL"] == "osmesa"
