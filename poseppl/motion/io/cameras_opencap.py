"""Calibrations of OpenCap: a pickle a camera, ``Videos/Cam0/cameraIntrinsicsExtrinsics.pickle``, in mm.

It holds ``intrinsicMat`` (3 x 3), ``distortion`` (5), ``imageSize`` (height, width), ``rotation`` (3 x 3) and ``translation``.
Nothing of the pickle is run, see :mod:`poseppl.files.plain_pickle`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from poseppl.errors import FilePath, InputError, Location
from poseppl.files.bounded_reading import check_file
from poseppl.files.plain_pickle import plain_of_pickle
from poseppl.motion.io.camera_fields import CameraRecord, coefficients, image_size, intrinsics, rotation, translation

SUFFIXES = (".pickle", ".pkl")
_GENERIC = "cameraIntrinsicsExtrinsics"


def read_opencap_camera(path: FilePath) -> CameraRecord:
    """Read one camera, named after its file, or its folder where the file has OpenCap's own name.

    Raises:
        InputError: The file holds anything but plain values, or a field is missing or malformed.
    """
    at = Location(path)
    source = check_file(path, max_bytes=2**20)
    try:
        data = source.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    fields = plain_of_pickle(data, at)
    if not isinstance(fields, dict):
        raise at.error("no camera", "OpenCap's cameraIntrinsicsExtrinsics.pickle")

    def of(name: str) -> tuple[Location, Any]:
        if name not in fields:
            raise at.in_field(name).error("the field is missing")
        value = fields[name]
        return at.in_field(name), value.tolist() if isinstance(value, np.ndarray) else value

    where, size = of("imageSize")
    stem = Path(path).stem
    name = Path(path).resolve().parent.name if stem == _GENERIC else stem.removesuffix("_" + _GENERIC)
    return CameraRecord(
        name=name or "camera",
        matrix=intrinsics(*of("intrinsicMat")),
        distortion=coefficients(of("distortion")[0], _flat(of("distortion")[1]), False),
        rotation=rotation(*of("rotation")),
        translation=translation(of("translation")[0], _flat(of("translation")[1])),
        size=image_size(where, _flat(size)[::-1]),
    )


def _flat(value: Any) -> list[Any]:
    rows = value if isinstance(value, list) else [value]
    return [entry for row in rows for entry in (row if isinstance(row, list) else [row])]
