"""The folder of a scene: everything is there and can be read back, the seed makes it, and a failure leaves nothing."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError, PosepplError
from poseppl.files.atomic_writing import atomic_folder
from poseppl.motion.io import read_cameras, read_masks, read_places
from poseppl.motion.io.opencv import opencv
from poseppl.motion.io.video_writing import video_writer
from poseppl.motion.rendering import SensorNoise, Setting, Truth, write_scene
from poseppl.motion.rendering.figure import JOINTS
from poseppl.motion.rendering.render import expose, expose_long

Build = Callable[..., Setting]
RATE = 30.0


def truth_of(setting: Setting) -> Truth:
    places = np.stack([setting.figure.points[joint] for joint in JOINTS], axis=1)
    places[1, 4] = np.nan
    return Truth(np.array([0, 30, 60]), RATE, JOINTS, places, 'a "walk"\n')


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.full
def test_everything_is_there_and_reads_back(drawable: Build, tmp_path: Path) -> None:
    cv2 = opencv()
    setting, counted = drawable(cameras=2), []
    truth = truth_of(setting)
    write_scene(tmp_path / "scene", setting, truth, lossless=True, advance=counted.append)
    assert counted == [1, 1, 1] and [path.name for path in tmp_path.iterdir()] == ["scene"]
    folder = tmp_path / "scene"
    names = {"scene.toml", "Calib.toml", "truth.csv"}
    for camera in ("camera_1", "camera_2"):
        names |= {f"{camera}{end}" for end in (".mp4", "_visible.npz", "_whole.npz", "_background.png", "_occluder.png")}
        names |= {f"{camera}/{frame:06d}.png" for frame in range(3)}
    assert set(contents(folder)) == names
    for ours, read in zip(setting.cameras, read_cameras(folder / "Calib.toml"), strict=True):
        assert ours.name == read.name and ours.size == read.size
        for field in ("matrix", "rotation", "translation"):
            assert np.array_equal(getattr(ours, field), getattr(read, field))
    frames, places = read_places(folder / "truth.csv", JOINTS)
    assert frames.tolist() == [0, 30, 60]
    assert np.array_equal(places, truth.places, equal_nan=True)
    described = tomllib.loads((folder / "scene.toml").read_text())
    assert described["source"] == 'a "walk"\n' and described["clutter"] and len(described["furniture"]) >= 4
    for camera in ("camera_1", "camera_2"):
        visible, whole = (read_masks(folder / f"{camera}_{kind}.npz") for kind in ("visible", "whole"))
        assert visible.shape == whole.shape == (3, 72, 96) and visible.any() and not (visible & ~whole).any()
        plate = cv2.imread(str(folder / f"{camera}_background.png"))
        video = cv2.VideoCapture(str(folder / f"{camera}.mp4"))
        assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(RATE)
        for frame in range(3):
            lossless = cv2.imread(str(folder / camera / f"{frame:06d}.png")).astype(int)
            done, lossy = video.read()
            assert done and np.abs(lossless - lossy).mean() < 6  # grey levels that MPEG-4 loses
            change = np.abs(lossless - plate).max(-1)
            assert np.median(change[visible[frame]]) > 5 * np.median(change[~whole[frame]])
        occluder = cv2.imread(str(folder / f"{camera}_occluder.png"), cv2.IMREAD_GRAYSCALE)
        values = [0, *range(256 - len(described["furniture"]), 256)]
        assert len(np.unique(occluder)) > 2 and set(np.unique(occluder)) <= set(values)
        assert np.all(occluder[(whole & ~visible).any(0)] > 0)


@pytest.mark.full
def test_the_seed_makes_the_scene(drawable: Build, tmp_path: Path) -> None:
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        setting = drawable(cameras=1, seed=seed)
        write_scene(tmp_path / name, setting, truth_of(setting), lossless=True)
    one, same, other = (contents(tmp_path / name) for name in "abc")
    assert one == same
    for name in ("camera_1/000000.png", "camera_1_background.png", "camera_1_occluder.png", "scene.toml"):
        assert one[name] != other[name]


@pytest.mark.full
def test_a_failure_leaves_nothing(drawable: Build, tmp_path: Path) -> None:
    setting = drawable(cameras=1)

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_scene(tmp_path / "scene", setting, truth_of(setting), advance=interrupted)
    assert not list(tmp_path.iterdir())
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="the output exists"):
        write_scene(tmp_path / "taken", setting, truth_of(setting))
    assert contents(tmp_path) == {"taken/mine.txt": b"mine"}


def test_a_folder_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with atomic_folder(tmp_path / "done") as folder:
        (folder / "part").mkdir()
        (folder / "part" / "file").write_text("x")
    assert contents(tmp_path) == {"done/part/file": b"x"}
    with pytest.raises(InputError, match="does not exist"), atomic_folder(tmp_path / "absent" / "scene"):
        pass
    with pytest.raises(PosepplError, match="disk is full"), atomic_folder(tmp_path / "scene"):
        raise OSError(28, "No space left on device")
    assert contents(tmp_path) == {"done/part/file": b"x"}


def test_a_video_that_lacks_frames_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = np.zeros((72, 96, 3), np.uint8)
    with pytest.raises(PosepplError, match="2 of 3 frames"), video_writer(tmp_path / "a.mp4", 30.0) as video:
        video.write(frame)
        video.write(frame)
        monkeypatch.setattr(video, "count", 3)


def test_noise_has_the_level_that_was_asked_for() -> None:
    grey = np.full((200, 300, 3), 127, np.uint8)
    noise = SensorNoise(level=0.02, gain=0.05, flicker=0.0)
    seen = expose(grey, noise, seed=1, camera=2, frame=3).astype(float)
    # 60,000 pixels tell a standard deviation to 0.3 %; rounding adds 1/12 grey level squared, 0.2 %
    gains = expose_long(grey, noise, seed=1, camera=2)[0, 0] / 127
    expected = 255 * 0.02 * np.sqrt(0.5 + gains * 127 / 255)
    np.testing.assert_allclose(seen.std(axis=(0, 1)), expected, rtol=0.02)
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), 127 * gains, atol=0.6)  # the long exposure is rounded
    assert np.array_equal(seen, expose(grey, noise, 1, 2, 3))
    assert not np.array_equal(seen, expose(grey, noise, 1, 2, 4))
    assert np.array_equal(expose(grey, SensorNoise(0, 0, 0), 0, 0, 0), grey)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("frame,marker,x\n", "expected frame,marker,x,y,z"),
        ("frame,marker,x,y,z\n", "no position"),
        ("frame,marker,x,y,z\n0,a,1,2\n", "4 values"),
        ("frame,marker,x,y,z\nzero,a,1,2,3\n", "no frame number"),
        ("frame,marker,x,y,z\n0,a,1,2,nan\n", "line 2, z"),
        ("frame,marker,x,y,z\n0,a,1,2,3\n0,a,1,2,3\n", "twice"),
    ],
)
def test_places_that_cannot_be_read(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "truth.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_places(tmp_path / "truth.csv", ["a"])


@pytest.mark.full
def test_masks_that_cannot_be_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "masks.npz", masks=np.zeros((2, 3, 1), np.uint8))
    for name, told in (("masks.npz", "packed bits"), ("absent.npz", "absent.npz: no such file")):
        with pytest.raises(InputError, match=told):
            read_masks(tmp_path / name)
