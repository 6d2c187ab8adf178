"""Words of the options of a detector's keypoints: files, numbers and sizes by camera, the calibration, the person."""

from __future__ import annotations

from typing import Any

from poseppl.cli.options import chosen
from poseppl.errors import InputError, brief
from poseppl.files.decimal_numbers import decimal_number


def words_of_keypoints(words: tuple[str, ...]) -> dict[str, str]:
    """Files and folders by camera.

    Raises:
        InputError: A word is no CAMERA=FILE, or names a camera again.
    """
    return _by_camera(words, "--keypoints", "CAMERA=FILE, such as cam1=pose/cam1_json")


def numbers_of_cameras(words: tuple[str, ...] | None, option: str) -> dict[str, float]:
    """Numbers by camera.

    Raises:
        InputError: A word is no CAMERA=NUMBER, or names a camera again.
    """
    expected = "CAMERA=NUMBER, such as cam2=3.5"
    found = _by_camera(words or (), option, expected)
    return {camera: number_of_text(text, option, expected) for camera, text in found.items()}


def number_of_text(text: str, option: str, expected: str) -> float:
    """A finite number of at most 1e9."""
    value = decimal_number(text.strip())
    if value is None or not abs(value) <= 1e9:
        raise InputError(f"{brief(text)} is not a number", field=option, expected=expected)
    return value


def _by_camera(words: tuple[str, ...], option: str, expected: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for word in words:
        camera, equals, value = str(word).partition("=")
        if not (camera and equals and value):
            raise InputError(brief(word), field=option, expected=expected)
        if camera in found:
            raise InputError(f"the camera {brief(camera)} comes twice", field=option, expected="each camera once")
        found[camera] = value
    return found


def calibration_of(options: dict[str, Any]) -> Any:
    """The calibration, with the unit, the axis that is up and the sizes of pictures that the options give.

    Raises:
        InputError: The file or an option cannot be used.
    """
    from poseppl.motion.io import read_calibration
    from poseppl.motion.io.camera_fields import with_size

    found, sizes = read_calibration(options["calibration"], options["unit"], options.get("up")), sizes_of_pictures(options)
    for camera in sizes:
        if camera not in (known := [record.name for record in found.cameras]):
            raise InputError(f"no camera {camera!r} in the calibration", field="--image-size", expected=", ".join(known))
    cameras = (with_size(record, sizes.get(record.name, record.size)) for record in found.cameras)
    return found._replace(cameras=tuple(cameras))


def sizes_of_pictures(options: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Width and height of the pictures of some cameras, px."""
    sizes = {}
    for camera, text in _by_camera(options["image_size"] or (), "--image-size", "CAMERA=WxH, such as cam2=960x540").items():
        width, _, height = text.lower().partition("x")
        if not all(
            side.isascii() and side.isdigit() and len(side) < 7 and 1 <= int(side) <= 100_000 for side in (width, height)
        ):
            raise InputError(f"{camera}={brief(text)}", field="--image-size", expected="CAMERA=WxH in px, such as cam2=960x540")
        sizes[camera] = (int(width), int(height))
    return sizes


def about_person(options: dict[str, Any]) -> dict[str, Any]:
    """Arguments that tell of the person, its keypoints and their errors."""
    from poseppl.motion.keypoints.detector_files import read_detector_errors

    known = options["detector_errors"]
    return {
        **chosen(options, "layout", "noise", "stature", "lengths"),
        "person": options["person"] or 1,
        "refine": not options["keep_calibration"],
        "detector_errors": None if known is None else read_detector_errors(known),
    }
