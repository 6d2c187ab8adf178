from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.vision import (
    BackgroundSettings,
    background_from_plate,
    check_mask,
    clean_mask,
    keep_together,
    learn_background,
)

RNG = np.random.default_rng(0)
SCENE = np.repeat(RNG.integers(60, 180, (12, 16, 3), dtype=np.uint8).repeat(10, 0).repeat(10, 1)[None], 1, axis=0)[0]
PLAIN = BackgroundSettings(min_area=20, largest_hole=0)


def noisy(image, seed):
    noise = np.random.default_rng(seed).normal(0, 3, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def with_person(left, top=30, colour=(230, 20, 220)):
    """The scene with a block of 20 x 50 px, and its true mask."""
    image, mask = SCENE.copy(), np.zeros(SCENE.shape[:2], np.uint8)
    image[top : top + 50, left : left + 20] = colour
    mask[top : top + 50, left : left + 20] = 1
    return image, mask


def overlap(first, second):
    return (first & second).sum() / (first | second).sum()


@pytest.mark.parametrize("kind", ["plate", "empty clip", "the clip itself"])
def test_a_moving_block(kind):
    # 20 px wide and 2 px a frame: the block covers each pixel in 10 of 60 frames, the background shows in the others.
    frames = [noisy(with_person(5 + 2 * number)[0], number) for number in range(60)]
    backgrounds = {
        "plate": lambda: background_from_plate(SCENE, PLAIN),
        "empty clip": lambda: learn_background((noisy(SCENE, 100 + seed) for seed in range(20)), PLAIN),
        "the clip itself": lambda: learn_background(frames, PLAIN),
    }
    background = backgrounds[kind]()
    for number in (0, 17, 59):
        found, ignore = background.subtract(frames[number])
        # Opening and closing round the block's four corners: some 20 px of 1000.
        assert overlap(found, with_person(5 + 2 * number)[1]) > 0.96
        assert found.dtype == np.uint8 and set(np.unique(found)) == {0, 1} and not ignore.any()
    assert not background.subtract(noisy(SCENE, 999)).foreground.any()


def test_a_frozen_background_forgets_the_order():
    background = background_from_plate(SCENE, PLAIN)
    image, _ = with_person(40)
    first = background.subtract(image).foreground
    for _ in range(50):
        again = background.subtract(image).foreground
    np.testing.assert_array_equal(first, again)
    adapting = background_from_plate(SCENE, PLAIN._replace(learning_rate=0.1))
    for _ in range(50):
        again = adapting.subtract(image).foreground
    assert first.any() and not again.any()


def test_shadows():
    image, block = with_person(40)
    shadow = np.zeros_like(block)
    shadow[30:80, 80:110] = 1
    image[shadow == 1] = (0.75 * image[shadow == 1]).astype(np.uint8)
    inner = np.s_[35:75, 85:105]
    for kind, share in (("background", (0, 0)), ("foreground", (1, 0)), ("ignore", (0, 1))):
        # A foreground shadow has holes where 0.75 of a dark patch is still within the threshold; the rest is found.
        found, ignore = background_from_plate(SCENE, PLAIN._replace(shadows=kind)).subtract(image)
        assert found[inner].mean() == pytest.approx(share[0], abs=0.2)
        assert ignore[inner].mean() == pytest.approx(share[1], abs=0.2)
        assert found[35:75, 42:58].all() and not np.any(found & ignore)
    off = background_from_plate(SCENE, PLAIN._replace(shadow=1.0)).subtract(image).foreground
    assert off[inner].mean() > 0.8


def test_ignored_pixels_are_no_foreground():
    image, mask = with_person(40)
    ignore = np.zeros_like(mask)
    ignore[:, :50] = 255
    found, blind = background_from_plate(SCENE, PLAIN).subtract(image, ignore)
    assert not found[:, :50].any() and blind[:, :50].all() and not blind[:, 50:].any()
    assert overlap(found[:, 50:], mask[:, 50:]) > 0.95


def test_cleaning():
    mask = np.zeros((80, 80), np.uint8)
    mask[10:50, 10:50] = 1
    mask[20:24, 20:24] = 0  # a hole of 16 px
    mask[30:44, 30:44] = 0  # a hole of 196 px
    mask[60:66, 60:66] = 1  # a region of 36 px
    mask[5, 70] = 1  # a speck
    mask[0:20, 30] = 0  # a crack 1 px wide, open to the outside
    settings = {"opening": 3, "closing": 5, "min_area": 40, "largest_hole": 50}
    cleaned = clean_mask(mask, **settings)
    assert cleaned[20:24, 20:24].all() and not cleaned[33:41, 33:41].any()
    assert not cleaned[55:, 55:].any() and cleaned[5, 70] == 0 and cleaned[14, 30] == 1
    untouched = clean_mask(mask, opening=0, closing=0, min_area=0, largest_hole=0)
    np.testing.assert_array_equal(untouched, mask)
    assert not clean_mask(np.zeros_like(mask), **settings).any() and clean_mask(np.ones_like(mask), **settings).all()


@pytest.mark.full
def test_large_pictures_are_cleaned_alike():
    """In a picture of three times the width a person is cracked and specked by three times as many pixels."""
    scene, damaged = (np.full((480, 640, 3), level, np.uint8) for level in (90, 90))
    mask = np.zeros((480, 640), np.uint8)
    mask[100:400, 250:350] = 1
    damaged[mask > 0] = 200
    damaged[240:244] = 90  # a crack from side to side
    rows, columns = np.random.default_rng(1).integers(0, 480, (2, 40))
    damaged[rows, columns] = 200
    found = [background_from_plate(larger(scene, times)).subtract(larger(damaged, times)).foreground for times in (1, 3)]
    assert overlap(found[0], mask) > 0.99
    assert overlap(found[1], larger(mask, times=3)) > 0.99


def larger(picture, times):
    return picture.repeat(times, 0).repeat(times, 1)


def test_a_hole_at_the_rim_is_no_hole():
    mask = np.ones((40, 40), np.uint8)
    mask[:, :3] = 0
    mask[10:14, 36:] = 0  # open to the right side of the image, but enclosed by mask otherwise
    cleaned = clean_mask(mask, opening=0, closing=0, min_area=0, largest_hole=30)
    assert not cleaned[:, :3].any() and cleaned[10:14, 36:].all()


@pytest.mark.parametrize(("level", "message"), [(0, "all black: no foreground"), (1, "all white: no background")])
def test_masks_that_say_nothing(level, message):
    with pytest.raises(InputError, match=f"camera left, frame 12: the foreground mask is {message}"):
        check_mask(np.full((20, 30), level, np.uint8), "left", 12)
    nearly = np.full((200, 300), level, np.uint8)
    nearly[0, 0] = 1 - level
    with pytest.raises(InputError, match="camera left, frame 0: the foreground mask is [0-9.]+% foreground"):
        check_mask(nearly, "left", 0)
    check_mask(with_person(40)[1], "left", 0)


def test_bad_input():
    with pytest.raises(InputError, match="no image to learn"):
        learn_background([])
    with pytest.raises(InputError, match="image 1 has 30 x 20 pixels"):
        learn_background([np.zeros((20, 40, 3), np.uint8), np.zeros((20, 30, 3), np.uint8)])
    background = background_from_plate(SCENE)
    with pytest.raises(InputError, match="the image has 30 x 20 pixels .expected 160 x 120"):
        background.subtract(np.zeros((20, 30, 3), np.uint8))
    with pytest.raises(InputError, match="the ignore mask has"):
        background.subtract(SCENE, np.zeros((20, 30), np.uint8))
    for wrong in ({"threshold": 0}, {"shadow": 0}, {"shadows": "dark"}, {"opening": -1}, {"learned_frames": 0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            BackgroundSettings(**wrong).check()


def test_a_long_clip_is_learned_from_evenly():
    # # 500 frames; the first half dark, the second bright. The selected frames must represent both halves alike.
    levels = [60] * 250 + [160] * 250
    settings = PLAIN._replace(learned_frames=20, background_share=0.9, shadow=1.0)
    background = learn_background((np.full((40, 40, 3), level, np.uint8) for level in levels), settings)
    for level, foreground in ((60, False), (160, False), (110, True)):
        assert background.subtract(np.full((40, 40, 3), level, np.uint8)).foreground.all() == foreground


def blocks(*boxes):
    """A mask of boxes (top, left, height, width)."""
    mask = np.zeros((240, 320), np.uint8)
    for top, left, height, width in boxes:
        mask[top : top + height, left : left + width] = 1
    return mask


def test_regions_far_from_the_largest_are_dropped_unless_something_hides_what_is_between():
    # of an area of 40 x 100 px regions up to sqrt(4000) / 2 = 32 px away are the person's; and then those near to them
    person, near, further, far = (50, 100, 100, 40), (170, 110, 20, 20), (215, 110, 20, 20), (20, 220, 30, 30)
    mask = blocks(person, near, further, far)
    np.testing.assert_array_equal(keep_together(mask, 0.5), blocks(person, near, further))
    table = blocks((40, 130, 30, 100))
    np.testing.assert_array_equal(keep_together(mask, 0.5, table), mask)
    np.testing.assert_array_equal(keep_together(mask, 0.2), blocks(person))
    np.testing.assert_array_equal(keep_together(blocks(far), 0.5), blocks(far))
    assert not keep_together(blocks(), 0.5).any()


def test_background_keeps_the_person_alone():
    image, mask = with_person(40)
    image[70:80, 140:155] = 255 - SCENE[70:80, 140:155]
    both = background_from_plate(SCENE, PLAIN._replace(reach=0.0)).subtract(image).foreground
    alone = background_from_plate(SCENE, PLAIN).subtract(image).foreground
    assert both[75, 147] and not alone[75, 147] and overlap(alone, mask) > 0.96


def test_an_arm_of_nearly_the_colour_of_the_wall_is_found_by_that_of_the_rest():
    scene = np.full((200, 160, 3), (120, 110, 100), np.uint8)
    scene[20:170, 50:100] = 20  # the wall is dark behind all but the arm
    truth = blocks((30, 60, 130, 40), (60, 100, 30, 12))[:200, :160]
    image = noisy(np.where(truth[..., None] > 0, np.uint8([132, 120, 108]), scene), 0)
    found = [
        background_from_plate(scene, PLAIN._replace(refine=refine)).subtract(image).foreground for refine in (False, True, True)
    ]
    arm = np.s_[64:86, 101:110]
    assert found[0][arm].mean() < 0.2 and found[1][arm].mean() > 0.9
    assert overlap(found[0], truth) < 0.95 < 0.97 < overlap(found[1], truth)
    np.testing.assert_array_equal(found[1], found[2])


@pytest.mark.full
def test_refining_leaves_an_empty_mask_empty():
    assert not background_from_plate(SCENE, PLAIN._replace(refine=True)).subtract(noisy(SCENE, 1)).foreground.any()
