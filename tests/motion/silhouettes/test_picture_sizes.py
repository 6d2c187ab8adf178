"""Pictures whose size is not quite that of the calibration."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import CameraRecord, VideoWarning
from poseppl.motion.silhouettes.frame import fit_size

RECORD = CameraRecord("front", np.eye(3), np.zeros(5), np.eye(3), np.zeros(3), (1920, 1087))


@pytest.mark.parametrize(
    ("size", "how"),
    [((1920, 1088), "padding"), ((1920, 1086), "cut off"), ((1900, 1087), "cut off"), ((1935, 1087), "padding")],
)
def test_a_few_pixels_more_or_less_are_reported(size: tuple[int, int], how: str) -> None:
    with pytest.warns(VideoWarning, match=f"camera front: the pictures have {size[0]} x {size[1]} pixels.*assumed to be {how}"):
        assert fit_size(RECORD, size).size == size


@pytest.mark.full
@pytest.mark.parametrize("size", [(1920, 1103), (1936, 1087), (960, 544), (1920, 1060)])
def test_another_size_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="camera front: the pictures have .*the calibration 1920 x 1087"):
        fit_size(RECORD, size)


@pytest.mark.full
def test_the_same_size_is_the_same_record() -> None:
    assert fit_size(RECORD, (1920, 1087)) is RECORD
