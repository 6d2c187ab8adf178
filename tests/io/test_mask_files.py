"""Masks as packed bits: read back whole, opened as a video, and what is said of files that hold none."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")

from poseppl.errors import InputError
from poseppl.io import open_masks, read_masks
from poseppl.io.masks import pack_mask, write_masks

MASKS = np.random.default_rng(0).random((4, 7, 13)) < 0.5


@pytest.fixture
def path(tmp_path):
    write_masks(tmp_path / "masks.npz", [pack_mask(mask) for mask in MASKS], (13, 7))
    return tmp_path / "masks.npz"


def test_masks_are_read_back_and_opened_as_a_white_and_black_video(path):
    np.testing.assert_array_equal(read_masks(path), MASKS)
    video = open_masks(path, "left")
    assert (video.camera, video.size, video.num_frames) == ("left", (13, 7), 4)
    images = np.stack(list(video.images(1)))
    np.testing.assert_array_equal(images, np.repeat(255 * MASKS[1:, ..., None], 3, -1))


@pytest.mark.parametrize("lacking", ["masks", "shape", "bits", "frames", "everything"])
@pytest.mark.parametrize("read", [read_masks, open_masks])
def test_a_file_without_masks_is_told(path, lacking, read):
    packed, shape = np.packbits(MASKS, axis=-1), np.array(MASKS.shape)
    stored = {
        "masks": {"shape": shape},
        "shape": {"masks": packed},
        "bits": {"masks": packed[:, :, :1], "shape": shape},
        "frames": {"masks": packed[:2], "shape": shape},
    }
    if lacking in stored:
        np.savez_compressed(path, **stored[lacking])
    else:
        path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match=r"masks\.npz: .*no masks.*packed bits in masks and their shape"):
        read(path)
