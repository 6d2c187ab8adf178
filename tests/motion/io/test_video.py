from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from damage import damaged_copies

from poseppl.errors import InputError, PosepplError
from poseppl.motion.io import open_video, read_image, write_image, write_video
from poseppl.motion.io.opencv import opencv

SIZE = (64, 48)


def picture(number, size=SIZE):
    """A bright square that moves 1 px a frame to the right, over a ramp of colours."""
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0] = np.linspace(20, 120, width, dtype=np.uint8)
    image[..., 2] = np.linspace(20, 120, height, dtype=np.uint8)[:, None]
    image[10:26, number : number + 16] = 230
    return image


def clip(count):
    return [picture(number) for number in range(count)]


def column_of(image):
    """Position of the square: its centre, by the bright columns."""
    return np.flatnonzero(image[18].mean(axis=-1) > 175).mean() - 7.5


@pytest.fixture
def film(tmp_path):
    path = tmp_path / "front.mp4"
    assert write_video(path, clip(30), 25.0) == 30
    return path


def test_a_written_video_is_read_back(film):
    video = open_video(film, "front")
    assert (video.camera, video.size, video.num_frames, video.rate) == ("front", SIZE, 30, 25.0)
    images = list(video.images())
    assert len(images) == 30 and all(image.dtype == np.uint8 and image.shape == (48, 64, 3) for image in images)
    for number, image in enumerate(images):
        # The encoder loses detail: a few gray levels on the mean. Red and blue would swap at far more.
        assert np.abs(image.astype(float) - picture(number)).mean() < 6
        assert column_of(image) == pytest.approx(number, abs=0.6)


@pytest.mark.parametrize("start", [0, 1, 13, 29])
def test_a_start_frame_is_the_same_frame(film, start):
    video = open_video(film, "front")
    np.testing.assert_array_equal(next(video.images(start)), list(video.images())[start])
    assert len(list(video.images(start, start + 1))) == 1
    assert list(video.images(30)) == [] == list(video.images(5, 5))


def test_images_of_a_folder_or_a_pattern(tmp_path):
    for number in (2, 10, 6):  # in the order of the numbers, not of the letters
        write_image(tmp_path / f"image{number}.png", picture(number))
    (tmp_path / "notes.txt").write_text("not an image")
    for source in (tmp_path, str(tmp_path / "*.png")):
        video = open_video(source, "left", rate=30)
        assert (video.num_frames, video.rate, video.size) == (3, 30, SIZE)
        for number, image in zip((2, 6, 10), video.images(), strict=True):
            np.testing.assert_array_equal(image, picture(number))
    np.testing.assert_array_equal(next(open_video(tmp_path, "left").images(2)), picture(10))


def test_gray_becomes_three_equal_channels(tmp_path):
    gray = picture(3)[..., 0]
    write_image(tmp_path / "gray.bmp", gray)
    np.testing.assert_array_equal(read_image(tmp_path / "gray.bmp"), np.repeat(gray[..., None], 3, axis=-1))
    video = open_video(np.stack([gray, gray]), "top")
    assert video.num_frames == 2
    np.testing.assert_array_equal(next(video.images(1)), read_image(tmp_path / "gray.bmp"))


def test_the_hash_is_of_the_content(film, tmp_path):
    copy = tmp_path / "copy.mp4"
    copy.write_bytes(film.read_bytes())
    assert open_video(film, "a").digest() == open_video(copy, "b").digest()
    write_video(copy, clip(29), 25.0)
    assert open_video(film, "a").digest() != open_video(copy, "a").digest()
    assert open_video(clip(2)).digest() == open_video(np.stack(clip(2))).digest() != open_video(clip(3)).digest()


def test_a_recorded_video(data_dir):
    video = open_video(data_dir / "pose2sim_balancing" / "videos" / "cam03.mp4", "cam03")
    assert (video.size, video.num_frames, video.rate) == ((1088, 1920), 100, 60)
    seventh = list(video.images(0, 8))[7]
    np.testing.assert_array_equal(next(video.images(7)), seventh)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent.mp4", None, "absent.mp4: no such file"),
        ("empty.mp4", b"", "the file is empty"),
        ("noise.mp4", b"noise" * 500, "camera front: cannot be decoded"),
        ("noise.avi", b"RIFF" + b"noise" * 500, "camera front: cannot be decoded"),
    ],
)
def test_files_that_are_no_video(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        open_video(tmp_path / name, "front")


def test_a_video_that_is_cut_off(tmp_path):
    whole = tmp_path / "whole.avi"
    write_video(whole, clip(30), 25.0, codec="MJPG")
    half = tmp_path / "half.avi"
    half.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    video = open_video(half, "front")
    count = 0
    with pytest.raises(InputError, match=r"half\.avi, camera front, frame \d+: cannot be decoded, or the file is cut off"):
        for _ in video.images():
            count += 1
    assert 5 < count < 25
    assert len(list(video.images(0, 5))) == 5


def test_a_frame_that_the_decoder_passes_over(tmp_path):
    cv2, path = opencv(), tmp_path / "broken.webm"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP80"), 25.0, (160, 120))
    assert writer.isOpened()
    noise = np.random.default_rng(0).integers(0, 255, (120, 200, 3), dtype=np.uint8)
    for number in range(40):  # noise that moves needs so many bytes that the file has several clusters of frames
        writer.write(np.ascontiguousarray(noise[:, number : number + 160]))
    writer.release()
    data = bytearray(path.read_bytes())
    middle, tenth = len(data) // 2, len(data) // 10
    data[middle : middle + tenth] = bytes(tenth)
    path.write_bytes(data)
    video = open_video(path, "front")
    with pytest.raises(InputError, match=r"camera front, frame \d+: cannot be decoded, or is left out: time goes on from"):
        list(video.images())


def test_an_image_that_cannot_be_decoded_in_the_middle(tmp_path):
    for number in range(4):
        write_image(tmp_path / f"{number}.png", picture(number))
    whole = (tmp_path / "2.png").read_bytes()
    (tmp_path / "2.png").write_bytes(whole[: len(whole) // 2])
    stream = open_video(tmp_path, "front").images()
    next(stream), next(stream)
    with pytest.raises(InputError, match=r"2\.png, camera front, frame 2: cannot be decoded"):
        next(stream)
    write_image(tmp_path / "2.png", picture(2, (32, 48)))
    with pytest.raises(InputError, match="camera front, frame 2: the image has 32 x 48 pixels .expected 64 x 48"):
        list(open_video(tmp_path, "front").images())
    (tmp_path / "2.png").unlink()
    with pytest.raises(InputError, match=r"camera front, frame 2: no image with the number 2, after 1\.png"):
        open_video(tmp_path, "front")


def test_sources_without_images(tmp_path):
    for source in (tmp_path, str(tmp_path / "*.png"), []):
        with pytest.raises(InputError, match="no image"):
            open_video(source, "front")
    write_image(tmp_path / "1.png", picture(1))
    write_image(tmp_path / "1.jpg", picture(1))
    with pytest.raises(InputError, match="images of kinds .jpg, .png"):
        open_video(tmp_path, "front")
    with pytest.raises(InputError, match="camera front, frame 1: an array of shape"):
        open_video([picture(0), picture(0).astype(float)], "front")


def test_frames_that_are_not_there(film):
    video = open_video(film, "front")
    for start, stop in ((0, 31), (31, None)):
        with pytest.raises(InputError, match="camera front: the video has 30 frames, 31 were asked for"):
            list(video.images(start, stop))
    with pytest.raises(InputError, match="0 <= start <= stop"):
        list(video.images(3, 2))


def test_a_video_is_written_whole_or_not_at_all(film):
    before = film.read_bytes()

    def broken():
        yield from clip(3)
        raise RuntimeError("the renderer failed")

    for images, error, message in (
        (broken(), RuntimeError, "the renderer failed"),
        ([], InputError, "no image to write"),
        ([picture(0), picture(0)[:, :50]], InputError, "frame 1: the image has 50 x 48 pixels"),
        ([picture(0).astype(float)], InputError, "frame 0: an array of shape"),
        ([picture(0)[:, 1:]], InputError, "images of 63 x 48 pixels .expected an even width and height"),
    ):
        with pytest.raises(error, match=message):
            write_video(film, images, 25.0)
        assert film.read_bytes() == before and [path.name for path in film.parent.iterdir()] == ["front.mp4"]
    with pytest.raises(InputError, match="unknown kind of video"):
        write_video(film.with_suffix(".txt"), clip(2), 25.0)
    with pytest.raises(PosepplError, match="this OpenCV cannot encode"):
        write_video(film, clip(2), 25.0, codec="????")


def test_images_are_written_whole_or_not_at_all(tmp_path):
    with pytest.raises(InputError, match="unknown kind of image"):
        write_image(tmp_path / "image.xyz", picture(0))
    with pytest.raises(InputError, match="the output folder does not exist"):
        write_image(tmp_path / "absent" / "image.png", picture(0))
    assert list(tmp_path.iterdir()) == []


def test_without_opencv(film, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(PosepplError, match=r"pip install 'poseppl\[vision\]'"):
        open_video(film, "front")
    with pytest.raises(PosepplError, match=r"pip install 'poseppl\[vision\]'"):
        write_video(film, clip(2), 25.0)


def png(width, height):
    """A black picture of one bit a pixel."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = zlib.compress(bytes(height * (1 + width // 8)), 1)
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize(("size", "told"), [((10_000, 10_000), "10000 x 10000 pixels"), ((16_000, 16_000), "too many pixels")])
def test_the_size_of_a_picture_is_read_before_it(tmp_path, size, told, monkeypatch):
    (tmp_path / "large.png").write_bytes(png(*size))
    assert (tmp_path / "large.png").stat().st_size < 2e6
    monkeypatch.setattr(opencv(), "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(InputError, match=rf"large\.png: {told} .expected at most 67108864 in all"):
        read_image(tmp_path / "large.png")


def test_kinds_that_only_opencv_knows_are_bounded_by_it(tmp_path):
    code = (
        "import sys; from poseppl.motion.io import read_image; from poseppl.errors import InputError\n"
        "try: read_image(sys.argv[1])\n"
        "except InputError as error: print(error)"
    )
    rgbe = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n"
    (tmp_path / "large.hdr").write_bytes(rgbe + bytes(100))
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "large.hdr")], capture_output=True, text=True, check=False
    )
    assert "large.hdr: cannot be decoded" in done.stdout and "PIXELS" in done.stdout, done.stderr


def test_the_size_of_a_video_is_read_before_its_frames(film, monkeypatch):
    monkeypatch.setattr("poseppl.motion.io.opencv.MAX_PIXELS", 64 * 48 - 1)
    with pytest.raises(InputError, match="camera front: 64 x 48 pixels .expected at most 3071 in all"):
        open_video(film, "front")


def test_damaged_pictures_are_refused_or_read(tmp_path):
    for name in ("a.png", "a.jpg", "a.tif"):
        write_image(tmp_path / name, picture(3))
        for damaged in damaged_copies((tmp_path / name).read_bytes(), 40):
            (tmp_path / name).write_bytes(damaged)
            with contextlib.suppress(InputError):
                assert read_image(tmp_path / name).ndim == 3


LISTS = ("ffconcat version 1.0\nfile 'elsewhere/other.mp4'\n", "#EXTM3U\n#EXTINF:1,\nelsewhere/other.mp4\n")
"""Playlists of FFmpeg and of HLS."""


@pytest.mark.parametrize("head", LISTS)
@pytest.mark.parametrize("suffix", [".mp4", ".m3u8", ".ffconcat"])
def test_lists_of_other_files_are_no_videos(tmp_path, monkeypatch, head, suffix):
    monkeypatch.chdir(tmp_path)
    Path("elsewhere").mkdir()
    write_video("elsewhere/other.mp4", [np.full((64, 64, 3), 200, np.uint8)] * 3, 25.0)
    assert open_video("elsewhere/other.mp4").num_frames == 3
    Path(f"list{suffix}").write_text(head)
    with pytest.raises(InputError, match="cannot be decoded"):
        open_video(f"list{suffix}")


def test_a_video_whose_name_is_no_text(tmp_path):
    name = tmp_path / os.fsdecode(b"a\xff.mp4")
    name.write_bytes(b"not read")
    with pytest.raises(InputError, match="not UTF-8"):
        open_video(name)
    with pytest.raises(InputError, match="not UTF-8"):
        write_video(name, clip(3), 25.0)


def test_a_picture_is_a_video_of_one_frame(tmp_path, capfd):
    image = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    path = tmp_path / "plate.png"
    write_image(path, image)
    video = open_video(path, "cam")
    assert (video.size, video.num_frames) == ((3, 2), 1)
    np.testing.assert_array_equal(next(iter(video.images())), image)
    assert capfd.readouterr() == ("", "")  # nothing of FFmpeg's
