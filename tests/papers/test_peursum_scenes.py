"""Scenes of Peursum, Venkatesh and West: circles and clutter; and that a field more has left other scenes who they were."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from poseppl_papers.images import scenes
from poseppl_papers.images.scenes import Scene, SeenScene, _subject, see
from poseppl_papers.images.systems import System
from poseppl_papers.images.tracking import Blind, Tracking
from poseppl_papers.peursum.plan import annealed
from poseppl_papers.peursum.scenes import circle_scenes, clutter_scenes
from poseppl_papers.recordings import BUILT_IN, Recording

from poseppl.errors import InputError
from poseppl.motion.io import read_masks, read_motion
from poseppl.motion.rendering.render import load_mujoco

WALK = Recording("walk", "/there/walk.amc", "/there/walk.asf", "0123")
SYSTEM = System("peursum", "package.module:builder", 4)


@pytest.fixture(scope="module")
def walk(data_dir):
    return Recording.of_file("07_01", data_dir / "cmu_walks" / "07_01.amc", data_dir / "cmu_walks" / "07.asf")


def test_scenes_as_recorded_are_found_where_they_were():
    """Folders and keys of what was rendered and computed before scenes had circles."""
    assert Scene(BUILT_IN, False).folder.name == "94893facc88c37cb7a498fb7"
    assert Scene(WALK, True).folder.name == "9daaaca1d33b64fba13883ec"
    scene = Scene(WALK, clutter=False)
    assert Blind(scene, SYSTEM, 5).key == "blind-peursum-walk-clean-048777ef49bbcc7c"
    tracking = Tracking(scene, SYSTEM, 5, annealed(20), (0, 1))
    assert tracking.key == "peursum-walk-clean-Simple-APF-10-x-20-0-c3cad0cc64442457"
    circle = replace(scene, radius=1200.0)
    assert circle.folder != scene.folder and circle.name != scene.name
    (silent,) = clutter_scenes([WALK], 1)
    known = replace(silent, announced=True)
    assert silent.folder == known.folder and silent.name == f"{known.name}-unannounced"
    assert Blind(circle, SYSTEM, 5).key != Blind(scene, SYSTEM, 5).key


@pytest.mark.parametrize("announced", [True, False])
def test_unannounced_furniture_is_not_left_out(announced, monkeypatch):
    """Trackers are given the pixels of furniture, or none."""
    given, mask = [], np.ones((2, 3), np.uint8)
    video = SimpleNamespace(camera="a", images=lambda: iter([mask]))
    sources = SimpleNamespace(videos=[video], plates={"a": video}, occlusion={"a": mask})
    monkeypatch.setattr(scenes, "video_features", lambda *args, occlusion, **_: given.append(occlusion) or iter(["features"]))
    seen = SeenScene(25.0, None, np.zeros((1, 15, 3)), sources, announced)
    assert [sight.features for sight in seen.sights(1)] == [("features",)]
    assert given[0] is (mask if announced else None)


@pytest.mark.full
def test_the_papers_scenes():
    recordings = [replace(WALK, name=name, digest=name) for name in "abcd"]
    circles, cluttered = circle_scenes(recordings, 4), clutter_scenes(recordings, 3, num_frames=50)
    assert [scene.recording.name for scene in circles] == list("abcd")
    assert [scene.recording.name for scene in cluttered] == list("abc")
    assert {(s.clutter, s.rate, s.width, s.height, s.radius, s.num_frames) for s in circles} == {
        (False, 60.0, 640, 480, 1200.0, 150)
    }
    assert {(s.clutter, s.rate, s.width, s.height, s.radius, s.num_frames, s.announced) for s in cluttered} == {
        (True, 25.0, 384, 288, None, 50, False)
    }
    with pytest.raises(InputError, match="4 walks"):
        circle_scenes(recordings[:3], 4)


@pytest.mark.full
def test_frames_have_the_rate_that_is_asked_for(walk):
    whole = read_motion(walk.path, walk.skeleton)
    root = whole.positions[:, whole.index("root")]
    even, _ = _subject(Scene(walk, False, 4, rate=30.0))
    np.testing.assert_array_equal(even.markers[:, 0], root[:16:4])
    assert even.frames.tolist() == [0, 4, 8, 12] and even.rate == 30.0
    uneven, toes = _subject(Scene(walk, False, 6, rate=25.0))
    times = np.arange(6) * 120 / 25
    expected = np.stack([np.interp(times, np.arange(len(root)), root[:, axis]) for axis in range(3)], -1)
    np.testing.assert_allclose(uneven.markers[:, 0], expected, atol=1e-9)
    assert uneven.rate == 25.0 and uneven.frames.tolist() == [0, 5, 10, 14, 19, 24] and len(toes["toe_l"]) == 6
    with pytest.raises(InputError, match="at most 120"):
        _subject(Scene(walk, False, 4, rate=125.0))


@pytest.mark.full
def test_circles_turn_left_in_view_of_all_cameras(walk, tmp_path, monkeypatch):
    load_mujoco()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    see.cache_clear()
    scene = replace(circle_scenes([walk], 1, 5)[0], rate=2.0, width=96, height=72)
    seen = see(scene)
    see.cache_clear()
    steps = np.diff(seen.truth[:, 0, :2], axis=0)
    ahead = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.all(np.diff(ahead) > 0.2)
    hips = seen.truth[:, 10, :2] - seen.truth[:, 4, :2]
    assert np.unwrap(np.arctan2(hips[:, 1], hips[:, 0]))[-1] - np.arctan2(hips[0, 1], hips[0, 0]) > 1.5
    for camera in (1, 2, 3, 4):
        shown = read_masks(scene.folder / f"camera_{camera}_visible.npz")
        assert shown.any(axis=(1, 2)).all()
        assert not shown[:, [0, -1]].any() and not shown[:, :, [0, -1]].any()  # nobody leaves the picture
