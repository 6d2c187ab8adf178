from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.vision import fourier_descriptors, outer_contour


def ellipse(a, b, count=4000):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([a * np.cos(angle), b * np.sin(angle)], axis=1)


def person(count=900):
    """A lobed closed curve without symmetry."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 50 + 12 * np.cos(3 * angle + 0.4) + 8 * np.sin(5 * angle) + 5 * np.cos(2 * angle + 1)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def test_the_outline_of_the_largest_region():
    mask = np.zeros((40, 50), np.uint8)
    mask[10:20, 15:35] = 7
    mask[13:16, 20:25] = 0
    mask[30:33, 3:6] = 1
    contour = outer_contour(mask)
    # The outermost pixels: 2 x 20 + 2 x 8, the hole and the smaller region left out.
    assert contour.shape == (56, 2)
    assert {tuple(point) for point in contour} == {
        (x, y) for x in range(15, 35) for y in range(10, 20) if x in (15, 34) or y in (10, 19)
    }
    assert outer_contour(np.zeros((5, 5))).shape == (0, 2)
    assert outer_contour(np.eye(9)[3:4].T @ np.eye(9)[4:5]).shape == (1, 2)


def test_descriptors_of_a_circle_and_an_ellipse():
    # A circle is Z_1 alone. The chords' lengths and their interpolation leave less than 1e-4.
    np.testing.assert_allclose(fourier_descriptors(ellipse(30, 30)), 0, atol=1e-4)
    flat = fourier_descriptors(ellipse(33, 27))
    # Half axes 30 (1 +- e), e = 0.1. By angle z = 30 (exp(it) + e exp(-it)); evenly in length t = s + (e/2) sin 2s, which moves
    # a quarter of e from the frequency -1 to 3. The error is of order e^2.
    np.testing.assert_allclose(flat[:4], [0.075, 0, 0, 0.025], atol=0.002)


@pytest.mark.parametrize("change", ["shift", "scale", "turn", "start", "direction", "mirror"])
def test_invariances(change):
    points = person()
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    changed = {
        "shift": points + [300, -40],
        "scale": 2.5 * points,
        "turn": points @ turn.T,
        "start": np.roll(points, 217, axis=0),
        "direction": points[::-1],
        "mirror": points * [-1, 1],
    }[change]
    # Another start resamples the polygon at other points: 1e-4 of the radius.
    np.testing.assert_allclose(fourier_descriptors(changed), fourier_descriptors(points), atol=1e-4)


def test_shapes_are_distinguished():
    one, other, rough = (fourier_descriptors(points) for points in (person(), ellipse(50, 30), np.rint(person())))
    near, far = np.linalg.norm(one - rough), np.linalg.norm(one - other)
    # Rounded to whole px, half a px in 50 at most.
    assert 0 < near < 0.04 < 0.2 < far


def test_contours_without_area():
    for points in (np.zeros((0, 2)), np.zeros((1, 2)), np.array([[0, 0], [1, 1], [2, 2], [1, 1]])):
        assert np.isnan(fourier_descriptors(points)).all()
    assert fourier_descriptors(person(), 7).shape == (7,)
    with pytest.raises(InputError, match="1 to 200"):
        fourier_descriptors(person(), 0)


@pytest.mark.full
def test_recorded_silhouettes(data_dir):
    with np.load(data_dir / "pose2sim_balancing" / "silhouettes" / "cam03_masks_half.npz") as stored:
        masks = np.unpackbits(stored["masks"], axis=-1)[..., : stored["shape"][-1]]
    descriptors = [fourier_descriptors(outer_contour(masks[frame])) for frame in (0, 1, 2, 50)]
    steps = np.linalg.norm(np.array(descriptors[1:]) - descriptors[0], axis=-1)
    # 60 Hz: the next frames look alike, one 0.8 s later does not.
    assert steps[:2].max() < 0.5 * steps[2]
