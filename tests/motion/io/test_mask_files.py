"""Masks as packed bits: read back whole, opened as a video, and what is said of files that hold none."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")

from damage import damaged_copies

from poseppl.errors import InputError
from poseppl.motion.io import open_masks, read_masks
from poseppl.motion.io.masks import write_masks

MASKS = np.random.default_rng(0).random((4, 7, 13)) < 0.5


@pytest.fixture
def path(tmp_path):
    write_masks(tmp_path / "masks.npz", list(np.packbits(MASKS, axis=-1)), (13, 7))
    return tmp_path / "masks.npz"


def test_masks_are_read_back_and_opened_as_a_white_and_black_video(path):
    np.testing.assert_array_equal(read_masks(path), MASKS)
    video = open_masks(path, "left")
    assert (video.camera, video.size, video.num_frames) == ("left", (13, 7), 4)
    images = np.stack(list(video.images(1)))
    np.testing.assert_array_equal(images, np.repeat(255 * MASKS[1:, ..., None], 3, -1))


@pytest.mark.parametrize("lacking", ["masks", "shape", "bits", "frames", "everything"])
@pytest.mark.parametrize("read", [read_masks, open_masks])
def test_a_file_without_masks_is_reported(path, lacking, read):
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


def test_damaged_masks_are_refused(path):
    data = path.read_bytes()
    refused = 0
    for damaged in damaged_copies(data, 300):
        path.write_bytes(damaged)
        try:
            read_masks(path)
        except InputError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1
    assert refused > 150


def test_masks_are_bounded_by_their_header(path):
    # 100,000 frames of 8192 x 8192 are declared, in a few bytes
    shape = (100_000, 8192, 1024)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("shape.npy", "w") as stream:
            np.save(stream, np.array([100_000, 8192, 8192]))
        with archive.open("masks.npy", "w") as stream:
            np.lib.format.write_array_header_1_0(stream, {"descr": "|u1", "fortran_order": False, "shape": shape})
    with pytest.raises(InputError, match="masks.npy does not contain the array that it declares"):
        open_masks(path)


def test_masks_hold_no_more_than_they_declare(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("shape.npy", "w") as stream:
            np.save(stream, np.array(MASKS.shape))
        with archive.open("masks.npy", "w") as stream:
            np.save(stream, np.packbits(MASKS, axis=-1))
            stream.write(bytes(1000))
    with pytest.raises(InputError, match="masks.npy does not contain the array that it declares"):
        open_masks(path)
