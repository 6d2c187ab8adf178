from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import read_image
from poseppl.motion.vision import ColourSettings, bhattacharyya_distance, colour_bins, colour_histogram

SETTINGS = ColourSettings(hues=6, saturations=4, grays=8)


def flat(*colours):
    """Stripes, 10 columns each."""
    return np.array(colours, np.uint8)[None].repeat(10, axis=1).repeat(20, axis=0)


def test_bins_of_known_colours():
    red, green, blue, pale, dark, white = (255, 0, 0), (0, 255, 0), (0, 0, 255), (128, 126, 127), (9, 0, 0), (255, 255, 255)
    bins = colour_bins(flat(red, green, blue, pale, dark, white), SETTINGS)[0, ::10]
    # Hue 0, 120 and 240 degrees of 60 each, the highest of 4 saturations; then gray 128, 9 and 255 of 32 levels each.
    np.testing.assert_array_equal(bins, [3, 2 * 4 + 3, 4 * 4 + 3, 24 + 4, 24 + 0, 24 + 7])


def test_a_gray_image_has_gray_bins_only():
    gray = np.arange(256, dtype=np.uint8).reshape(16, 16)
    expected = 24 + np.arange(256).reshape(16, 16) // 32
    np.testing.assert_array_equal(colour_bins(gray, SETTINGS), expected)
    np.testing.assert_array_equal(colour_bins(gray[..., None].repeat(3, -1), SETTINGS), expected)


def test_histograms_of_regions():
    bins = colour_bins(flat((255, 0, 0), (0, 0, 255)), SETTINGS)
    mask = np.zeros((20, 20), np.uint8)
    mask[:, 5:] = 1  # 5 columns of red, 10 of blue
    histogram = colour_histogram(bins, SETTINGS, mask)
    assert (
        histogram.shape == (SETTINGS.bins,) and histogram[3] == pytest.approx(1 / 3) and histogram[19] == pytest.approx(2 / 3)
    )
    soft = np.where(np.arange(20) < 10, 3.0, 1.0) * np.ones((20, 1))
    assert colour_histogram(bins, SETTINGS, soft)[3] == pytest.approx(3 / 4)
    assert colour_histogram(bins, SETTINGS)[3] == pytest.approx(1 / 2)
    assert not colour_histogram(bins, SETTINGS, np.zeros((20, 20))).any()
    for wrong in (np.ones((3, 3)), -np.ones((20, 20)), np.full((20, 20), np.nan)):
        with pytest.raises(InputError, match="expected shape .20, 20., finite, none negative"):
            colour_histogram(bins, SETTINGS, wrong)


def test_distances():
    p, q = np.array([0.5, 0.5, 0.0]), np.array([0.5, 0.0, 0.5])
    assert bhattacharyya_distance(p, p) == pytest.approx(0, abs=1e-7)
    assert bhattacharyya_distance(p, q) == pytest.approx(np.sqrt(0.5))
    assert bhattacharyya_distance(p, np.zeros(3)) == 1


@pytest.mark.full
def test_a_recorded_person_keeps_his_colours(data_dir):
    """The same man in two cameras is nearer to himself than to the room."""
    folder = data_dir / "pose2sim_balancing" / "silhouettes"
    rooms = [colour_histogram(colour_bins(read_image(folder / f"cam0{number}_background_half.png"))) for number in (3, 4)]
    assert bhattacharyya_distance(rooms[0], rooms[1]) < 0.5
    assert bhattacharyya_distance(rooms[0], np.eye(110)[30]) > 0.9
