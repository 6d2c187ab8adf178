"""Calibrations of OpenCap: a pickle a camera, ``Videos/Cam0/cameraIntrinsicsExtrinsics.pickle``, in mm.

It holds ``intrinsicMat`` (3 x 3), ``distortion`` (5), ``imageSize`` (height, width), ``rotation`` (3 x 3) and ``translation``.
Nothing of the pickle is run, see :mod:`poseppl.files.plain_pickle`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_bytes
from poseppl.files.plain_pickle import plain_of_pickle
from poseppl.motion.io.camera_fields import CameraRecord, Field, camera_of_fields, image_size

SUFFIXES = (".pickle", ".pkl")
_GENERIC = "cameraIntrinsicsExtrinsics"


def read_opencap_camera(path: FilePath) -> CameraRecord:
    """Read one camera, named after its file, or its folder where the file has OpenCap's own name.

    Raises:
        InputError: The file holds anything but plain values, or a field is missing or malformed.
    """
    at = Location(path)
    fields = plain_of_pickle(read_bytes(path, max_bytes=2**20), at)
    if not isinstance(fields, dict):
        raise at.error("no camera", "OpenCap's cameraIntrinsicsExtrinsics.pickle")

    def of(name: str) -> Field:
        if name not in fields:
            raise at.in_field(name).error("the field is missing")
        value = fields[name]
        return at.in_field(name), value.tolist() if isinstance(value, np.ndarray) else value

    where, size = of("imageSize")
    height, width = image_size(where, size)
    stem = Path(path).stem
    name = Path(path).resolve().parent.name if stem == _GENERIC else stem.removesuffix("_" + _GENERIC)
    return camera_of_fields(
        name or "camera",
        matrix=of("intrinsicMat"),
        distortion=of("distortion"),
        rotation=of("rotation"),
        translation=of("translation"),
        size=(where, [width, height]),
    )
