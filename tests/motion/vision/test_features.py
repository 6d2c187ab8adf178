from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from damage import damaged_copies, unbalanced

from poseppl.errors import InputError
from poseppl.files.store import Store
from poseppl.motion.io import open_video
from poseppl.motion.vision import (
    BackgroundSettings,
    ColourSettings,
    EdgeSettings,
    FeatureSettings,
    FlowSettings,
    background_from_plate,
    cache,
    extract,
    feature_key,
    features_picture,
    scale_image,
    scale_mask,
    video_features,
)
from poseppl.motion.vision.cache import restored_features

PLATE = np.random.default_rng(0).integers(10, 50, (12, 16, 3), dtype=np.uint8).repeat(10, 0).repeat(10, 1)
CLOTH = np.random.default_rng(1).integers(150, 255, (10, 4, 1), dtype=np.uint8).repeat(5, 0).repeat(5, 1) * np.uint8([1, 0, 1])
SETTINGS = FeatureSettings(background=BackgroundSettings(min_area=20), flow=FlowSettings("dis_medium"))


def frame(number):
    """A purple block of 20 x 50 px that moves 2 px a frame over the scene."""
    image = PLATE.copy()
    image[30:80, 20 + 2 * number : 40 + 2 * number] = CLOTH
    return image


def equal(first, second):
    """To the last digit, read or computed again."""
    for one, other in zip(first, second, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def test_the_features_of_a_frame():
    features = extract(frame(5), background_from_plate(PLATE, SETTINGS.background), SETTINGS, previous=frame(4))
    block = np.s_[33:77, 33:47]
    for plane in features[:6]:
        assert plane.shape == (120, 160)
    assert features.foreground[block].all() and features.foreground.sum() == pytest.approx(1000, abs=40)
    assert features.silhouette_distance[55, 40] == pytest.approx(-9.5, abs=1.1) and features.silhouette_distance[0, 159] == 50
    # The block's own outline is an edge: purple is brighter than all of the scene.
    assert np.median(features.edge_distance[40:70, 29:31]) < 1 and features.edge_distance[55, 100] > 40
    assert features.edge_proximity[40:70, 30].mean() > 0.8
    # Purple: 300 degrees is bin 8 of 10 hues, fully saturated.
    assert features.histogram[8 * 10 + 9] > 0.9 and features.histogram.sum() == pytest.approx(1)
    assert np.isfinite(features.descriptors).all() and len(features.descriptors) == 20
    np.testing.assert_allclose(np.median(features.flow[block], axis=(0, 1)), [2, 0], atol=0.35)
    assert features.flow_outliers[block].mean() < 0.2 and not features.ignore.any()


def test_features_do_not_depend_on_where_memory_lies():
    background = background_from_plate(PLATE[:, :157], SETTINGS.background)
    kept = []
    for number in range(12):
        kept.append(np.empty(1000 * number + 16, np.uint8))
        before, now = (frame(each)[:, :157].copy() for each in (4, 5))
        kept.append(extract(now, background, SETTINGS, previous=before))
        equal(kept[-1], kept[1])


def test_parts_that_are_left_out():
    background = background_from_plate(PLATE, SETTINGS.background)
    for features in (
        extract(frame(5), background, SETTINGS),
        extract(frame(5), background, SETTINGS._replace(flow=None), previous=frame(4)),
    ):
        assert features.flow.shape == (0, 0, 2) and features.flow_outliers.shape == (0, 0)


def test_ignored_pixels_have_no_edges():
    ignore = np.zeros((120, 160), np.uint8)
    ignore[:55] = 1
    features = extract(frame(5), background_from_plate(PLATE, SETTINGS.background), SETTINGS, ignore=ignore)
    assert not features.edges[:55].any() and features.edges[60:].any() and features.ignore[:55].all()


def test_furniture_gives_no_evidence_but_where_the_person_is_before_it():
    background, furniture = background_from_plate(PLATE, SETTINGS.background), np.zeros((120, 160), np.uint8)
    furniture[:55] = 1
    alone = extract(frame(5), background, SETTINGS)
    features = extract(frame(5), background, SETTINGS, occlusion=furniture)
    shown = alone.foreground != 0
    assert shown[:55].any() and not shown[:55].all() and shown[55:].any()
    np.testing.assert_array_equal(features.foreground, alone.foreground)
    np.testing.assert_array_equal(features.ignore != 0, (furniture != 0) & ~shown)
    np.testing.assert_array_equal(features.edges, np.where(features.ignore != 0, 0, alone.edges))


@pytest.mark.parametrize("flood", ["nobody", "everything"])
def test_a_frame_without_evidence(flood):
    image = PLATE if flood == "nobody" else 255 - PLATE // 4
    background = background_from_plate(PLATE, SETTINGS.background)
    with pytest.raises(InputError, match="camera left, frame 7: the foreground mask is all (black|white)"):
        extract(image, background, SETTINGS, camera="left", frame=7)
    features = extract(image, background, SETTINGS, camera="left", frame=7, previous=frame(1), bad_mask="ignore")
    assert features.ignore.all() and not features.foreground.any() and not features.edges.any()
    assert not features.histogram.any() and np.isnan(features.descriptors).all()
    assert np.all(features.edge_distance == 50) and np.all(features.silhouette_distance == 50)


def test_scaled_features():
    settings = SETTINGS._replace(scale=0.5)
    background = background_from_plate(scale_image(PLATE, 0.5), settings.background)
    ignore = np.zeros((120, 160), np.uint8)
    ignore[100, 101] = 1
    features = extract(frame(5), background, settings, previous=frame(4), ignore=ignore)
    assert features.foreground.shape == (60, 80) and features.foreground[17:38, 17:23].all()
    assert features.ignore.sum() == 1 and features.ignore[50, 50] == 1
    assert np.median(features.flow[18:37, 17:23, 0]) == pytest.approx(1, abs=0.35)
    assert scale_mask(ignore[::2], np.zeros((30, 80, 3), np.uint8)).shape == (30, 80)


def test_features_are_kept(tmp_path, monkeypatch):
    video = open_video([frame(number) for number in range(6)], "left")
    options = {"folder": tmp_path, "plate": PLATE}
    first = list(video_features(video, SETTINGS, **options))
    kept = sorted(path.name for path in tmp_path.rglob("*.npz"))
    assert len(first) == 6 and kept == [f"{number:06d}.npz" for number in range(6)]
    for features, again in zip(first, video_features(video, SETTINGS, plate=PLATE), strict=True):
        equal(features, again)

    def forbidden(*arguments, **options):
        raise AssertionError("computed again")

    with monkeypatch.context() as patch:
        patch.setattr(cache, "extract", forbidden)
        patch.setattr(cache, "learn_background", forbidden)
        for features, again in zip(first, video_features(video, SETTINGS, **options), strict=True):
            equal(features, again)
    broken, notes = next(tmp_path.rglob("000003.npz")), []
    whole = broken.read_bytes()
    for content in (whole[:2000], b"", b"noise"):
        broken.write_bytes(content)
        for features, again in zip(first, video_features(video, SETTINGS, **options, note=notes.append), strict=True):
            equal(features, again)
        assert len(broken.read_bytes()) == len(whole) and "damaged" in notes.pop() and not notes
    # Asked for alone, a frame is what it is in the whole run: the frame before is read for its flow.
    equal(first[4], next(video_features(video, SETTINGS, plate=PLATE, start=4)))


@pytest.mark.full
def test_features_damaged_anywhere_are_taken_again(tmp_path):
    kept = extract(frame(5), background_from_plate(PLATE, SETTINGS.background), SETTINGS, previous=frame(4))
    store, name = Store(tmp_path, "features", print, max_unpacked=2**20), "a"
    store.save(name, kept._asdict(), {})
    data, refused = (tmp_path / "a.npz").read_bytes(), 0
    for damaged in [unbalanced(data), *damaged_copies(data, 500)]:
        (tmp_path / "a.npz").write_bytes(damaged)
        found = store.load(name, {}, partial(restored_features, settings=SETTINGS))
        refused += found is None
        if found is not None:
            equal(kept, found)
    assert refused > 400


def test_what_changes_the_key():
    video, other = open_video([frame(0)], "left"), open_video([frame(1)], "left")
    keys = {
        feature_key(video, SETTINGS, None, None),
        feature_key(other, SETTINGS, None, None),
        feature_key(video, SETTINGS, PLATE, None),
        feature_key(video, SETTINGS, None, PLATE[..., 0]),
        feature_key(video, SETTINGS, None, None, PLATE[..., 0]),
        feature_key(video, SETTINGS, None, None, bad_mask="ignore"),
        feature_key(video, SETTINGS._replace(edges=EdgeSettings(sigma=4.0)), None, None),
    }
    assert len(keys) == 7
    assert feature_key(video._replace(camera="right"), SETTINGS, None, None) in keys


def test_the_background_is_learned_from_the_video():
    video = open_video([frame(number) for number in range(50)], "left")
    (features,) = video_features(video, SETTINGS, start=25, stop=26)
    expected = next(video_features(video, SETTINGS, plate=PLATE, start=25))
    both, either = features.foreground & expected.foreground, features.foreground | expected.foreground
    assert both.sum() / either.sum() > 0.95


def test_videos_without_a_known_end_and_bad_ones():
    video = open_video([frame(number) for number in range(3)], "left")
    assert len(list(video_features(video._replace(num_frames=None), SETTINGS, plate=PLATE))) == 3
    with pytest.raises(InputError, match="camera left"):
        list(video_features(video, SETTINGS, plate=PLATE, stop=5))
    with pytest.raises(InputError, match="camera left, frame 1: the foreground mask is all black"):
        list(video_features(open_video([frame(0), PLATE], "left"), SETTINGS, plate=PLATE))
    adapting = SETTINGS._replace(background=BackgroundSettings(learning_rate=0.1))
    with pytest.raises(ValueError, match="learning_rate"):
        list(video_features(video, adapting, plate=PLATE))


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": 0.0},
        {"scale": 2.0},
        {"truncation": 0.0},
        {"descriptors": 0},
        {"edges": EdgeSettings(sigma=0.0)},
        {"colour": ColourSettings(hues=0)},
        {"flow": FlowSettings(margin=-1)},
        {"background": BackgroundSettings(components=0)},
    ],
)
def test_bad_settings(wrong):
    with pytest.raises(ValueError, match="Expected"):
        FeatureSettings(**wrong).check()


def test_the_picture(tmp_path):
    background = background_from_plate(PLATE, SETTINGS.background)
    ignore = np.zeros((120, 160), np.uint8)
    ignore[:20] = 1
    features = extract(frame(5), background, SETTINGS, previous=frame(4), ignore=ignore)
    picture = features_picture(frame(5), features)
    assert picture.shape == (2 * (120 + 22), 4 * 160, 3)
    np.testing.assert_array_equal(picture[22:142, :160], frame(5))
    np.testing.assert_array_equal(picture[22 + 55, 160 + 40], [255, 255, 255])
    np.testing.assert_array_equal(picture[22 + 5, 160 + 5], [255, 150, 0])
    assert features_picture(frame(5), extract(frame(5), background, SETTINGS)).shape == picture.shape


@pytest.mark.full
def test_files_of_another_time(tmp_path):
    features = extract(frame(5), background_from_plate(PLATE, SETTINGS.background), SETTINGS)
    equal(restored_features(features._asdict(), SETTINGS), features)
    with pytest.raises(ValueError, match="other shapes"):
        restored_features(features._asdict(), SETTINGS._replace(descriptors=7))
    with pytest.raises(ValueError, match="other shapes"):
        restored_features(features._replace(edges=np.zeros((3, 3), np.uint8))._asdict(), SETTINGS)
    with pytest.raises(KeyError):
        restored_features({"foreground": features.foreground}, SETTINGS)
