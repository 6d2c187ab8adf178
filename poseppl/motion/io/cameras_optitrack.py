"""Calibrations of OptiTrack's Motive, ``.mcal``: XML with an element a camera, in metres.

``Extrinsic`` has the camera's centre (X, Y, Z) and the rotation from its axes (x right, y up, z backwards) to the world's, by
rows. ``IntrinsicStandardCameraModel`` has OpenCV's coefficients. Motive's own model, ``Intrinsic``, is not read.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from poseppl.errors import Location
from poseppl.motion.io.camera_fields import MAX_CAMERAS, CameraRecord, intrinsics, rotation_matrix
from poseppl.motion.io.camera_xml import NumberAttributes
from poseppl.motion.io.text_parsing import check_distinct

_AXES = np.diag([1.0, -1.0, -1.0])
_MODEL = "IntrinsicStandardCameraModel"


def optitrack_cameras(root: ElementTree.Element, at: Location) -> tuple[CameraRecord, ...]:
    """The cameras of a calibration of Motive, by their serial, lengths in m.

    Args:
        root: The XML.
        at: The file, for messages.

    Raises:
        InputError: It holds no camera, or a field is missing or malformed.
    """
    elements = [element for element in root.iter("Camera") if element.find("Extrinsic") is not None]
    if not elements or len(elements) > MAX_CAMERAS:
        raise at.error("the file has no calibrated camera", "elements <Camera> with <Extrinsic>")
    cameras = tuple(_camera(element, index, at) for index, element in enumerate(elements))
    check_distinct([camera.name for camera in cameras], "cameras", at.in_field("Serial"))
    return cameras


def _camera(element: ElementTree.Element, index: int, at: Location) -> CameraRecord:
    name = element.get("Serial") or str(index)
    where = at.in_field(f"camera {name}")
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
