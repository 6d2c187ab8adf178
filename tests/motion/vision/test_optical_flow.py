from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import open_video
from poseppl.motion.io.opencv import opencv
from poseppl.motion.vision import FlowSettings, dense_flow, flow_outliers, foreground_flow, scale_image

METHODS = ["dis_ultrafast", "dis_fast", "dis_medium", "farneback"]


def texture(seed, shape=(120, 160)):
    noise = np.random.default_rng(seed).integers(0, 255, shape, dtype=np.uint8)
    smooth = opencv().GaussianBlur(noise, (0, 0), 2.0).astype(float)
    return np.clip(128 + 5 * (smooth - smooth.mean()), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("method", METHODS)
def test_a_shifted_image(method):
    wide = texture(0, (140, 180))
    before, after = wide[10:130, 10:170], wide[8:128, 7:167]  # the content moves 3 px to the right and 2 px down
    flow = dense_flow(before, after, method)
    assert flow.shape == (120, 160, 2) and flow.dtype == np.float32
    inner = flow[20:-20, 20:-20]
    # A shift of a textured image is found to a tenth of a px on the median; by the fast searches, which work on a quarter
    # or half of the resolution, to a third.
    tolerance = 0.35 if method in ("dis_ultrafast", "dis_fast") else 0.1
    np.testing.assert_allclose(np.median(inner, axis=(0, 1)), [3, 2], atol=tolerance)
    outliers = flow_outliers(flow, dense_flow(after, before, method))
    assert outliers[20:-20, 20:-20].mean() < 0.05


def test_outliers_by_their_equation():
    forth, back = np.zeros((40, 50, 2), np.float32), np.zeros((40, 50, 2), np.float32)
    forth[..., 0], back[..., 0] = 4.0, -4.0
    outliers = flow_outliers(forth, back)
    assert not outliers[:, :46].any() and outliers[:, 46:].all()  # the last 4 columns leave the image
    back[:, 24:, 0] = -2.0
    # A miss of 2 px: 4 > 0.01 (16 + 4) + 0.5, where the flow ends, 4 px to the right.
    outliers = flow_outliers(forth, back)
    assert not outliers[:, :20].any() and outliers[:, 20:].all()
    assert not flow_outliers(forth, back, FlowSettings(absolute=4.0))[:, :46].any()


def test_what_is_hidden_is_an_outlier():
    ground, block = texture(1), texture(2)
    before, after = ground.copy(), ground.copy()
    before[40:80, 40:80] = block[40:80, 40:80]
    after[40:80, 48:88] = block[40:80, 40:80]  # 8 px to the right, over what was seen before
    flow = dense_flow(before, after, "dis_medium")
    outliers = flow_outliers(flow, dense_flow(after, before, "dis_medium"))
    np.testing.assert_allclose(np.median(flow[50:70, 50:70], axis=(0, 1)), [8, 0], atol=0.3)
    assert outliers[45:75, 81:87].mean() > 0.6 > 0.1 > outliers[50:70, 50:70].mean()


def test_flow_around_the_foreground():
    wide = texture(3, (200, 300))
    before, after = wide[:, 5:], wide[:, 3:-2]
    foreground = np.zeros(before.shape, np.uint8)
    foreground[80:120, 100:140] = 1
    flow, outliers = foreground_flow(before, after, foreground, FlowSettings(margin=20, method="dis_medium"))
    np.testing.assert_allclose(np.median(flow[80:120, 100:140], axis=(0, 1)), [2, 0], atol=0.1)
    assert outliers[80:120, 100:140].mean() < 0.05
    outliers[60:140, 80:160] = 1
    flow[60:140, 80:160] = 0
    assert outliers.all() and not flow.any()
    nothing = foreground_flow(before, after, np.zeros_like(foreground))
    assert not nothing[0].any() and nothing[1].all()


@pytest.mark.full
def test_bad_input():
    with pytest.raises(InputError, match="expected two of one size"):
        dense_flow(texture(0), texture(0)[:-1])
    with pytest.raises(InputError, match="16 px at least"):
        dense_flow(texture(0)[:10], texture(0)[:10])
    for wrong in ({"method": "none"}, {"relative": -1.0}, {"absolute": -1.0}, {"margin": -1}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            FlowSettings(**wrong).check()


@pytest.mark.full
def test_a_recorded_person_moves_and_the_room_does_not(data_dir):
    folder = data_dir / "pose2sim_balancing"
    video = open_video(folder / "videos" / "cam04.mp4", "cam04")
    before, after = (scale_image(image, 0.5) for image in video.images(20, 22))
    with np.load(folder / "silhouettes" / "cam04_masks_half.npz") as stored:
        mask = np.unpackbits(stored["masks"][21], axis=-1)[:, : stored["shape"][-1]]
    length = np.linalg.norm(dense_flow(before, after, "dis_medium"), axis=-1)
    assert length[mask == 1].mean() > 5 * np.median(length[mask == 0])
