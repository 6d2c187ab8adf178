"""Contrast-normalised edge energy: blind to contrast, not to edges."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.motion.vision import EnergySettings, edge_energy, gradient, motion_boundaries


def steps(contrast):
    """Two edges, of so many gray levels, and half a wall without any."""
    image = np.full((80, 160), 100, np.uint8)
    image[:, 20:40] += np.uint8(contrast)
    return image


def test_an_edge_in_the_shade_counts_as_much():
    """Energies of edges of 30 and 120 gray levels differ by less than 15 %; their Sobel gradients by a factor of four."""
    weak, strong = edge_energy(steps(30)), edge_energy(steps(120))
    for column in (20, 40):
        near = slice(column - 2, column + 2)
        assert weak[40, near].max() > 0.5 and abs(weak[40, near].max() / strong[40, near].max() - 1) < 0.15
        faint, bright = (np.abs(gradient(steps(contrast))[0][40, near]).max() for contrast in (30, 120))
        assert bright == pytest.approx(4 * faint, rel=0.1)
    assert weak[:, 100:].max() < 1e-3 and np.all((weak >= 0) & (weak < 1))


def test_a_floor_keeps_noise_down():
    """On a wall with a standard deviation of 1 gray level; without a floor the noise would be edges."""
    noisy = (100 + np.random.default_rng(0).normal(0, 1, (80, 80))).round().astype(np.uint8)
    assert np.median(edge_energy(noisy)) < 0.15 < np.median(edge_energy(noisy, EnergySettings(floor=0.01)))


@pytest.mark.full
def test_motion_boundaries_are_smoothed_outliers():
    outliers = np.zeros((40, 40), np.uint8)
    outliers[10:30, 10:30] = 1
    found = motion_boundaries(outliers)
    assert found[20, 20] > 0.95 and found[20, 10] == pytest.approx(0.5, abs=0.1) and found[2, 2] < 0.01


@pytest.mark.full
def test_settings_out_of_range():
    with pytest.raises(ValueError, match="window"):
        edge_energy(steps(30), EnergySettings(window=0.0))
