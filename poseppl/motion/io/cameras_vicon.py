"""Calibrations of Vicon, ``.xcp``: XML with an element a camera, in mm.

ORIENTATION is the quaternion (x, y, z, w) that takes the world's axes to the camera's (x right, y down, z forward), POSITION
the camera's centre. Only cameras with a KeyFrame were calibrated.

VICON_RADIAL2 has the centre of the distortion, px, and k1, k2, k3. They move an image point p to where a camera without
distortion would have it, centre + (p - centre) (1 + k1 r^2 + k2 r^4 + k3 r^6), r px from the centre. VICON_RADIAL has k1 and k2
about the principal point. OpenCV's coefficients go the other way: they are fitted to this over the picture.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import Location
from poseppl.motion.io.camera_fields import MAX_CAMERAS, CameraRecord, intrinsics, numbers
from poseppl.motion.io.camera_xml import NumberAttributes
from poseppl.motion.io.text_parsing import check_distinct, parse_number

LARGEST_ERROR = 0.5
"""px by which OpenCV's coefficients may miss Vicon's in the picture, and the centre the principal point."""
_RADII = 50


def vicon_cameras(root: ElementTree.Element, at: Location) -> tuple[CameraRecord, ...]:
    """The cameras of a calibration of Vicon, by the number of the device.

    Args:
        root: The XML.
        at: The file, for messages.

    Raises:
        InputError: It holds no calibrated camera, or a field is missing or malformed.
    """
    elements = [element for element in root.iter("Camera") if element.find("KeyFrames/KeyFrame") is not None]
    if not elements or len(elements) > MAX_CAMERAS:
        raise at.error("the file has no calibrated camera", "elements <Camera> with a <KeyFrame>")
    cameras = tuple(_camera(element, index, at) for index, element in enumerate(elements))
    check_distinct([camera.name for camera in cameras], "cameras", at.in_field("DEVICEID"))
    return cameras


def _camera(element: ElementTree.Element, index: int, at: Location) -> CameraRecord:
    name = element.get("DEVICEID") or str(index)
    where = at.in_field(f"camera {name}")
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
