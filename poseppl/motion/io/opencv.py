"""OpenCV, imported when it is first needed, and single images through it.

Arrays are RGB here and everywhere in poseppl; OpenCV's own order, BGR, does not leave this package.
"""

from __future__ import annotations

import importlib
import io
import os
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, InputError, Location, PosepplError
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_bytes

MAX_IMAGE_BYTES = 2**30
MAX_PIXELS = 2**26
"""Largest picture: 8192 x 8192, twice the pixels of a video of 7680 x 4320. Its header is read before anything is decoded."""
MAX_CHUNKS = 100_000
_PNG = b"\x89PNG\r\n\x1a\n"
Image = NDArray[np.uint8]


def opencv() -> ModuleType:
    """Import OpenCV.

    Returns:
        The module cv2.

    Raises:
        PosepplError: It is not installed, or its binary cannot be loaded.
    """
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))  # read when it is imported first
    try:
        return importlib.import_module("cv2")
    except ImportError as error:
        reason = "" if isinstance(error, ModuleNotFoundError) else f" ({error})"
        raise PosepplError(f"videos and images need OpenCV: pip install 'poseppl[vision]'{reason}") from error


def read_image(path: FilePath, camera: str | None = None, frame: int | None = None) -> Image:
    """Read an image of any format that OpenCV knows.

    Args:
        path: The file.
        camera: The camera, for messages.
        frame: The frame number, for messages.

    Returns:
        (H, W, 3) RGB, 8 bits a channel (a deeper image is scaled down); three equal channels where the file is gray.

    Raises:
        InputError: The file is missing, empty, no image, or of more than :data:`MAX_PIXELS`.
        PosepplError: OpenCV is not installed.
    """
    cv2 = opencv()
    at = place(camera, frame, path)
    data = read_bytes(path, max_bytes=MAX_IMAGE_BYTES)
    _check_chunks(data, at)
    _check_header(data, at)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise at.error(f"cannot be decoded: {error.err}", "an image") from error
    if image is None:
        raise at.error("cannot be decoded", "an image that OpenCV reads, whole")
    return to_rgb(image)


def check_pixels(size: tuple[int, int], at: Location) -> None:
    """Check the width and height that a picture or a video declares.

    Raises:
        InputError: There are more than :data:`MAX_PIXELS`.
    """
    width, height = size
    if width * height > MAX_PIXELS:
        raise at.error(f"{width} x {height} pixels", f"at most {MAX_PIXELS} in all")


def _check_header(data: bytes, at: Location) -> None:
    """Check the size that an encoded picture declares; one that only OpenCV knows is bounded by OpenCV."""
    from PIL import Image as Header

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is large, or its header odd
        try:
            with Header.open(io.BytesIO(data)) as header:
                size = header.size
        except Header.DecompressionBombError as error:
            raise at.error("too many pixels", f"at most {MAX_PIXELS} in all") from error
        except Exception:  # a damaged header may bring about anything; whether it is an image is for OpenCV to say
            return
    check_pixels(size, at)


def _check_chunks(data: bytes, at: Location) -> None:
    """Check the lengths of a PNG's chunks: OpenCV makes room for a chunk of any length before it reads it."""
    if not data.startswith(_PNG):
        return
    place = len(_PNG)
    for _ in range(MAX_CHUNKS):
        length = int.from_bytes(data[place : place + 4])
        if place + 12 + length > len(data):
            rest = max(len(data) - place - 12, 0)
            problem = f"cannot be decoded: a chunk of the PNG has {length} bytes, and the rest of the file {rest}"
            raise at.error(problem, "an image, whole; it may have been cut off")
        if data[place + 4 : place + 8] == b"IEND":
            return
        place += 12 + length
    raise at.error(f"more than {MAX_CHUNKS} chunks in the PNG", "an image in fewer")


def encode_image(image: Image, suffix: str = ".png", *, file: FilePath | None = None) -> bytes:
    """Turn an image into the bytes of a file; PNG keeps every value.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.
        suffix: Says the format.
        file: Name of the file of the bytes, for messages.

    Raises:
        InputError: The array is no image, or the suffix is unknown.
        PosepplError: OpenCV is not installed.
    """
    cv2 = opencv()
    checked = check_image(image)
    try:
        done, data = cv2.imencode(suffix, checked if checked.ndim == 2 else checked[..., ::-1])
    except cv2.error:
        done, data = False, None
    if not done or data is None:
        raise InputError("unknown kind of image", file=file, expected="a name that ends in .png, .jpg, .bmp or .tif")
    return bytes(data.tobytes())


def write_image(path: FilePath, image: Image) -> None:
    """Write an image, whole or not at all; PNG keeps every value.

    Args:
        path: The file; its suffix says the format.
        image: (H, W, 3) RGB or (H, W) gray.

    Raises:
        InputError: The file cannot be written, or its suffix is unknown.
        PosepplError: OpenCV is not installed, or the disk is full.
    """
    write_atomically(path, encode_image(image, Path(path).suffix or ".", file=path))


def to_rgb(image: Image) -> Image:
    """Turn OpenCV's image, BGR or gray, into RGB.

    Args:
        image: (H, W, 3) BGR or (H, W) gray.

    Returns:
        (H, W, 3) RGB.
    """
    cv2 = opencv()
    converted: Image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
    return converted


def check_name(path: FilePath) -> str:
    """Check that OpenCV can open a file by its name: one that is not UTF-8 ends the process.

    Raises:
        InputError: The name is none for OpenCV.
    """
    name = str(path)
    try:
        name.encode("utf-8")
    except UnicodeError as error:
        raise InputError("the name is not UTF-8, and OpenCV takes no other", file=path, expected="another name") from error
    return name


def check_image(image: Image, camera: str | None = None, frame: int | None = None) -> Image:
    """Check that an array is an image.

    Args:
        image: The array.
        camera: The camera, for messages.
        frame: The frame number, for messages.

    Returns:
        The image, in one piece of memory.

    Raises:
        InputError: The array is neither (H, W, 3) nor (H, W), is empty, or is not of type uint8.
    """
    array = np.asarray(image)
    if array.dtype != np.uint8 or array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,)) or array.size == 0:
        problem = f"an array of shape {array.shape} and type {array.dtype}"
        expected = "an image of shape (height, width, 3) RGB or (height, width) gray, of type uint8"
        raise place(camera, frame).error(problem, expected)
    return np.ascontiguousarray(array)


def place(camera: str | None, frame: int | None = None, file: FilePath | None = None) -> Location:
    """Position in a recording, for messages: "camera front, frame 12", or the known part of it."""
    parts = [f"camera {camera}" if camera is not None else "", f"frame {frame}" if frame is not None else ""]
    return Location(file, field=", ".join(part for part in parts if part) or None)
