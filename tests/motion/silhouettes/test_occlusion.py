"""A person half before and half behind furniture: where it hides nobody, the silhouette is evidence."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")

from poseppl.motion.io import CameraRecord
from poseppl.motion.silhouettes.frame import SilhouetteSettings, silhouette_frame

WIDTH, HEIGHT = 100, 120
RECORD = CameraRecord("left", np.eye(3), np.zeros(5), np.eye(3), np.zeros(3), (WIDTH, HEIGHT))
BEFORE, BEHIND = 200, 255
"""Values of what the person is before, and of what the person is behind."""


def room():
    """A person in columns 20 to 59, rows 10 to 109; from row 60 on before a thing to the left, behind another to the right."""
    mask, things = np.zeros((2, HEIGHT, WIDTH), np.uint8)
    mask[10:110, 20:60] = 1
    things[60:, :40], things[60:, 40:] = BEFORE, BEHIND
    mask[things == BEHIND] = 0
    return mask, things


def frame_of(mask, things):
    return silhouette_frame(mask, things, RECORD, 0, SilhouetteSettings(num_points=1000, map_size=HEIGHT))


def test_the_outline_is_that_before_furniture_and_not_what_furniture_cuts():
    frame = frame_of(*room())
    counted = {tuple(point) for point in frame.contour[frame.on_outline != 0].astype(int)}
    # without a margin of 2 px on either side of each thing's edge: row 60 is the first of the things, column 40 of the second
    sides = {(column, row) for column in (20, 59) for row in range(10, 58)}
    before = {(20, row) for row in range(62, 110)} | {(column, 109) for column in range(20, 38)}
    assert counted == sides | {(column, 10) for column in range(20, 60)} | before


def test_a_thing_as_one_with_what_hides_the_person_cuts_an_outline():
    mask, things = room()
    frame = frame_of(mask, things != 0)
    cut = (frame.contour[:, 0] == 39) & (frame.contour[:, 1] >= 62)
    assert cut.any() and frame.on_outline[cut].all()  # why things that the person is between have values of their own


@pytest.mark.parametrize("times", [1, 2])
def test_pixels_are_seen_hidden_or_empty(times):
    mask, things = (np.kron(each, np.ones((times, times), np.uint8)) for each in room())
    record = RECORD._replace(size=(times * WIDTH, times * HEIGHT))
    frame = silhouette_frame(mask, things, record, 0, SilhouetteSettings(map_size=HEIGHT))
    mask, things = room()
    np.testing.assert_array_equal(frame.person, np.where(mask, 1, np.where(things, -1, 0)))
    # only where nothing can hide the person does an empty pixel say that nobody is there
    np.testing.assert_array_equal(frame.distance < 0, frame.person != 0)


def test_without_the_person_seen_before_it_furniture_is_what_it_was():
    mask, things = room()
    mask[things != 0] = 0
    frame = frame_of(mask, things)
    assert set(frame.contour[frame.on_outline != 0, 1].astype(int)) == set(range(10, 58))
    assert set(np.unique(frame.person[things != 0])) == {-1}
