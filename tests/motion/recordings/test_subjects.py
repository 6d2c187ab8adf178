"""Which frames of the built-in walk are taken."""

from __future__ import annotations

import numpy as np

from poseppl.motion.recordings.subjects import walking_subject


def test_every_third_frame_of_the_walk_has_a_third_of_its_rate() -> None:
    part, whole = walking_subject(frames="3:12:3", rate=60.0), walking_subject(frames="0:12", rate=60.0)
    assert part.rate == 20.0 and part.frames.tolist() == [3, 6, 9]
    np.testing.assert_array_equal(part.states, whole.states[3:12:3])
    np.testing.assert_array_equal(part.markers, whole.markers[3:12:3])
