"""Calibrations of Qualisys, ``.qca.txt``: XML with a table a camera, in mm.

Focal lengths and centres are 64ths of a pixel, and so are distortion coefficients taken (k1, k2, p1, p2, k3), as Pose2Sim does.
``transform`` has the centre of the camera and the rotation of the world to axes of which y points up and z backwards.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from poseppl.errors import Location
from poseppl.motion.io.camera_fields import MAX_CAMERAS, CameraRecord, intrinsics, rotation_matrix
from poseppl.motion.io.camera_xml import NumberAttributes
from poseppl.motion.io.text_parsing import check_distinct

_SUBPIXELS = 64.0
_AXES = np.diag([1.0, -1.0, -1.0])


def qualisys_cameras(root: ElementTree.Element, at: Location) -> tuple[CameraRecord, ...]:
    """The cameras of a calibration of Qualisys.

    Args:
        root: The XML.
        at: The file, for messages.

    Raises:
        InputError: It holds no camera, or a field is missing or malformed.
    """
    elements = [element for element in root.iter("camera") if element.find("intrinsic") is not None]
    if not elements or len(elements) > MAX_CAMERAS:
        raise at.error("the file has no camera", "elements <camera> with <transform> and <intrinsic>")
    cameras = tuple(_camera(element, index, at) for index, element in enumerate(elements))
    check_distinct([camera.name for camera in cameras], "cameras", at.in_field("serial"))
    return cameras


def _camera(element: ElementTree.Element, index: int, at: Location) -> CameraRecord:
    name = element.get("serial") or str(index)
    where = at.in_field(f"camera {name}")
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
