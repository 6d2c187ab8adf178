"""Calibrations in XML, an element a camera: OptiTrack (``.mcal``, m), Qualisys (``.qca.txt``, mm) and Vicon (``.xcp``, mm)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import Location
from poseppl.motion.io.camera_fields import MAX_CAMERAS, CameraRecord, intrinsics, numbers, rotation_matrix
from poseppl.motion.io.text_parsing import check_distinct, parse_number

_Reader = Callable[[ElementTree.Element, str, Location], CameraRecord]


class NumberAttributes:
    """Numbers of the attributes of an element.

    Args:
        element: The element; None where it is missing.
        at: Position.

    Raises:
        InputError: The element is missing.
    """

    def __init__(self, element: ElementTree.Element | None, at: Location) -> None:
        self.at = at
        if element is None:
            raise at.error("it is missing")
        self._element = element

    def __call__(self, *names: str) -> Floats:
        """One number of each attribute."""
        return numbers(self.at, [self._parsed(name, self._text(name)) for name in names], 1)

    def list(self, name: str, count: int) -> Floats:
        """So many numbers of one attribute, that spaces separate."""
        words = self._text(name).split()
        if len(words) != count:
            raise self._field(name).error(f"{len(words)} values", f"{count} numbers")
        return numbers(self.at, [self._parsed(name, word) for word in words], 1)

    def _text(self, name: str) -> str:
        text = self._element.get(name)
        if text is None:
            raise self._field(name).error("it is missing")
        return text

    def _parsed(self, name: str, text: str) -> float:
        return parse_number(text.strip(), self._field(name))

    def _field(self, name: str) -> Location:
        return self.at.in_field(f"{self.at.field}.{name}")


def _cameras(
    root: ElementTree.Element, at: Location, tags: tuple[str, str, str], expected: str, read: _Reader
) -> tuple[CameraRecord, ...]:
    """Cameras of the elements of one tag that have an inner element, named by an attribute."""
    tag, inner, attribute = tags
    elements = [element for element in root.iter(tag) if element.find(inner) is not None]
    if not elements or len(elements) > MAX_CAMERAS:
        raise at.error("the file has no calibrated camera", expected)
    names = [element.get(attribute) or str(index) for index, element in enumerate(elements)]
    check_distinct(names, "cameras", at.in_field(attribute))
    return tuple(read(element, name, at.in_field(f"camera {name}")) for element, name in zip(elements, names, strict=True))


_AXES = np.diag([1.0, -1.0, -1.0])
_MODEL = "IntrinsicStandardCameraModel"


def optitrack_cameras(root: ElementTree.Element, at: Location) -> tuple[CameraRecord, ...]:
    """The cameras of a calibration of Motive, by their serial, lengths in m.

    ``Extrinsic`` has the camera's centre (X, Y, Z) and the rotation from its axes (x right, y up, z backwards) to the world's,
    by rows. ``IntrinsicStandardCameraModel`` has OpenCV's coefficients. Motive's own model, ``Intrinsic``, is not read.

    Args:
        root: The XML.
        at: The file, for messages.

    Raises:
        InputError: It holds no camera, or a field is missing or malformed.
    """
    return _cameras(root, at, ("Camera", "Extrinsic", "Serial"), "elements <Camera> with <Extrinsic>", _optitrack_camera)


def _optitrack_camera(element: ElementTree.Element, name: str, where: Location) -> CameraRecord:
    tags = (_MODEL, "Extrinsic", "Attributes")
    inner, outer, picture = (NumberAttributes(element.find(tag), where.in_field(f"{where.field}.{tag}")) for tag in tags)
    fx, fy, cx, cy = inner("HorizontalFocalLength", "VerticalFocalLength", "LensCenterX", "LensCenterY")
    k1, k2, k3, p1, p2 = inner("k1", "k2", "k3", "TangentialX", "TangentialY")
    width, height = picture("ImagerPixelWidth", "ImagerPixelHeight")
    if not (1 <= width <= 1e6 and 1 <= height <= 1e6):
        raise picture.at.error(f"{width:g} x {height:g} pixels", "a picture's size")
    turn = outer(*(f"OrientMatrix{number}" for number in range(9))).reshape(3, 3)
    rotation = _AXES @ rotation_matrix(outer.at, turn.tolist()).T
    return CameraRecord(
        name=name,
        matrix=intrinsics(inner.at, [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
        distortion=np.array([k1, k2, p1, p2, k3]),
        rotation=rotation,
        translation=-rotation @ outer("X", "Y", "Z"),
        size=(int(width), int(height)),
    )


_SUBPIXELS = 64.0


def qualisys_cameras(root: ElementTree.Element, at: Location) -> tuple[CameraRecord, ...]:
    """The cameras of a calibration of Qualisys.

    Focal lengths and centres are 64ths of a pixel, and so are distortion coefficients taken (k1, k2, p1, p2, k3), as Pose2Sim
    does. ``transform`` has the centre of the camera and the rotation of the world to axes of which y points up and z backwards.

    Args:
        root: The XML.
        at: The file, for messages.

    Raises:
        InputError: It holds no camera, or a field is missing or malformed.
    """
    return _cameras(
        root, at, ("camera", "intrinsic", "serial"), "elements <camera> with <transform> and <intrinsic>", _qualisys_camera
    )


def _qualisys_camera(element: ElementTree.Element, name: str, where: Location) -> CameraRecord:
    inner = _attributes(element, "intrinsic", where)
    left, top, right, bottom = _attributes(element, "fov_video", where)("left", "top", "right", "bottom")
    fx, fy, cx, cy, skew = inner("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew") / _SUBPIXELS
    k1, k2, k3, p1, p2 = (
        inner("radialDistortion1", "radialDistortion2", "radialDistortion3", "tangentalDistortion1", "tangentalDistortion2")
        / _SUBPIXELS
    )
    place = _attributes(element, "transform", where)
    turn = place(*(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))).reshape(3, 3)
    checked = _AXES @ rotation_matrix(where.in_field(f"{where.field}.transform"), turn.tolist())
    matrix = [[fx, skew, cx - left], [0.0, fy, cy - top], [0.0, 0.0, 1.0]]
    width, height = right - left + 1, bottom - top + 1
    if not (1 <= width <= 1e6 and 1 <= height <= 1e6):
        raise where.in_field(f"{where.field}.fov_video").error(f"{width:g} x {height:g} pixels", "a picture's size")
    return CameraRecord(
        name=name,
        matrix=intrinsics(where.in_field(f"{where.field}.intrinsic"), matrix),
        distortion=np.array([k1, k2, p1, p2, k3]),
        rotation=checked,
        translation=-checked @ place("x", "y", "z"),
        size=(int(width), int(height)),
    )


def _attributes(camera: ElementTree.Element, tag: str, at: Location) -> NumberAttributes:
    return NumberAttributes(camera.find(tag), at.in_field(f"{at.field}.{tag}"))


LARGEST_ERROR = 0.5
"""px by which OpenCV's coefficients may miss Vicon's in the picture, and the centre the principal point."""
_RADII = 50


def vicon_cameras(root: ElementTree.Element, at: Location) -> tuple[CameraRecord, ...]:
    """The cameras of a calibration of Vicon, by the number of the device.

    ORIENTATION is the quaternion (x, y, z, w) that takes the world's axes to the camera's (x right, y down, z forward),
    POSITION the camera's centre. Only cameras with a KeyFrame were calibrated.

    VICON_RADIAL2 has the centre of the distortion, px, and k1, k2, k3. They move an image point p to where a camera without
    distortion would have it, centre + (p - centre) (1 + k1 r^2 + k2 r^4 + k3 r^6), r px from the centre. VICON_RADIAL has k1
    and k2 about the principal point. OpenCV's coefficients go the other way: they are fitted to this over the picture.

    Args:
        root: The XML.
        at: The file, for messages.

    Raises:
        InputError: It holds no calibrated camera, or a field is missing or malformed.
    """
    return _cameras(
        root, at, ("Camera", "KeyFrames/KeyFrame", "DEVICEID"), "elements <Camera> with a <KeyFrame>", _vicon_camera
    )


def _vicon_camera(element: ElementTree.Element, name: str, where: Location) -> CameraRecord:
    outer = NumberAttributes(element, where)
    frame = element.find("KeyFrames/KeyFrame")
    inner = NumberAttributes(frame, where.in_field(f"{where.field}.KeyFrame"))
    width, height = outer.list("SENSOR_SIZE", 2)
    if not (1 <= width <= 1e6 and 1 <= height <= 1e6):
        raise where.in_field(f"{where.field}.SENSOR_SIZE").error(f"{width:g} x {height:g} pixels", "a picture's size")
    (focal,), (aspect,) = inner("FOCAL_LENGTH"), outer("PIXEL_ASPECT_RATIO")
    if aspect <= 0:
        raise where.in_field(f"{where.field}.PIXEL_ASPECT_RATIO").error(f"{aspect:g}", "a positive number")
    principal = inner.list("PRINCIPAL_POINT", 2)
    quaternion = inner.list("ORIENTATION", 4)
    if not 0.9 < np.linalg.norm(quaternion) < 1.1:
        raise where.in_field(f"{where.field}.ORIENTATION").error("no rotation", "a quaternion of length 1")
    rotation = Rotation.from_quat(quaternion).as_matrix()
    matrix = [[focal, 0.0, principal[0]], [0.0, focal / aspect, principal[1]], [0.0, 0.0, 1.0]]
    size = (int(width), int(height))
    return CameraRecord(
        name=name,
        matrix=intrinsics(where.in_field(f"{where.field}.FOCAL_LENGTH"), matrix),
        distortion=opencv_coefficients(_radial(frame, inner, principal, where), focal, principal, size, where),
        rotation=rotation,
        translation=-rotation @ inner.list("POSITION", 3),
        size=size,
    )


def _radial(frame: ElementTree.Element | None, inner: NumberAttributes, principal: Floats, at: Location) -> Floats:
    """Vicon's k1, k2, k3, px."""
    words = ((frame is not None and frame.get("VICON_RADIAL2")) or "").split()
    if not words:
        return np.append(inner.list("VICON_RADIAL", 2), 0.0)
    here = at.in_field(f"{at.field}.VICON_RADIAL2")
    if words[0] != "ViconRadial2" or len(words) != 6:
        raise here.error(f"{len(words)} values", "ViconRadial2, its centre, and three coefficients")
    values = numbers(here, [parse_number(word, here) for word in words[1:]], 1)
    if np.linalg.norm(values[:2] - principal) > LARGEST_ERROR:
        raise here.error("the centre of the distortion is not the principal point", "a calibration in which they are the same")
    return values[2:]


def opencv_coefficients(radial: Floats, focal: float, centre: Floats, size: tuple[int, int], at: Location) -> Floats:
    """OpenCV's coefficients (k1, k2, 0, 0, k3) of Vicon's, over a picture.

    Args:
        radial: Vicon's k1, k2, k3, px.
        focal: Focal length, px.
        centre: (2,) px.
        size: Width and height, px.
        at: The camera, for messages.

    Raises:
        InputError: They miss by more than half a pixel somewhere.
    """
    corners = np.array([(x, y) for x in (0, size[0]) for y in (0, size[1])]) - centre
    seen = np.linspace(0.0, float(np.linalg.norm(corners, axis=1).max()), _RADII)[1:]
    ideal = seen * (1 + seen[:, None] ** np.array([2, 4, 6]) @ radial) / focal
    powers = ideal[:, None] ** np.array([3, 5, 7])
    k1, k2, k3 = np.linalg.lstsq(powers, seen / focal - ideal, rcond=None)[0]
    missed = np.abs(powers @ [k1, k2, k3] + ideal - seen / focal).max() * focal
    if not missed <= LARGEST_ERROR or np.any(np.diff(ideal) <= 0):
        raise at.in_field(f"{at.field}.VICON_RADIAL").error(
            "a distortion that no picture has", "coefficients per px^2, px^4, px^6"
        )
    return np.array([k1, k2, 0.0, 0.0, k3])
