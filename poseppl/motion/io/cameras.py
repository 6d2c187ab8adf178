"""Calibrated cameras: TOML, read and written, OpenCap's pickles, and the door to all other formats.

Our TOML has one table a camera; lengths in mm, ``rotation`` and ``translation`` take world points to the camera's axes
(x right, y down, z forward), x_camera = R x_world + t:

    units = "mm"

    [camera.front]
    size = [1920, 1080]
    matrix = [[1500.0, 0.0, 960.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]]
    distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
    rotation = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    translation = [0.0, 1000.0, 5000.0]

Other formats are XML of Qualisys, Vicon (.xcp) and OptiTrack (.mcal) (:mod:`~poseppl.motion.io.cameras_xml`), and OpenCV's YAML
and EasyMocap's pair of files (:mod:`~poseppl.motion.io.cameras_yaml`). TOML may have
the tables of anipose and Pose2Sim, ``[cam_01]`` with ``name``, ``distortions`` and ``rotation`` as a rotation vector. It may
also have those of Caliscope, ``[cameras.0]``, whose ``rotation`` may be a matrix. Both are in metres unless ``units`` says
otherwise. Distortion coefficients are those of OpenCV, see :class:`~poseppl.motion.io.camera_fields.CameraRecord`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.errors import Argument, FilePath, InputError, Location, brief
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_bytes, read_toml, read_xml
from poseppl.files.plain_pickle import plain_of_pickle
from poseppl.motion.io.camera_fields import (
    MAX_CAMERAS as MAX_CAMERAS,
    Calibration as Calibration,
    CameraRecord as CameraRecord,
    Field,
    camera_of_fields,
    image_size,
    scaled,
    with_size,
    with_z_up,
)
from poseppl.motion.io.cameras_xml import optitrack_cameras, qualisys_cameras, vicon_cameras
from poseppl.motion.io.cameras_yaml import YAMLS, read_easymocap, read_opencv_camera
from poseppl.motion.io.text_parsing import LONGEST, check_distinct, parse_number
from poseppl.motion.io.units_and_axes import MM_PER_UNIT, check_axis, mm_per_unit
from poseppl.motion.settings import CameraFiles

_ASSUMED = "m"
_EXPECTED = (
    "TOML of poseppl, anipose, Pose2Sim or Caliscope, XML of Qualisys, Vicon or OptiTrack, a folder of OpenCV's YAML, of "
    "EasyMocap's intri.yml and extri.yml, or of OpenCap's pickles"
)


def read_cameras(path: FilePath) -> tuple[CameraRecord, ...]:
    """Read calibrated cameras; where a file does not tell the unit of its lengths, they are taken for metres.

    Args:
        path: The file, or a folder with one of each camera.

    Returns:
        The cameras, in the order of the file.

    Raises:
        InputError: The file is of no kind that is known, holds no camera, or a field is missing or malformed; the message names
            the field.
    """
    return read_calibration(path).cameras


def calibration_of(settings: CameraFiles) -> Calibration:
    """The calibration that settings name, with pictures of the sizes that they tell, or that they are given.

    Raises:
        InputError: The file cannot be used, or has no such camera.
    """
    given = settings.calibration
    if not isinstance(given, str | PathLike):
        return given if isinstance(given, Calibration) else Calibration(tuple(given), "mm")
    found = read_calibration(given, settings.unit, settings.up)
    sizes = {name: camera.size for name, camera in settings.cameras.items() if camera.size is not None}
    names = [record.name for record in found.cameras]
    for name in sizes:
        if name not in names:
            raise InputError(f"no camera {name!r} in the calibration", field=Argument("camera"), expected=", ".join(names))
    return found._replace(cameras=tuple(with_size(each, sizes.get(each.name, each.size)) for each in found.cameras))


def read_calibration(path: FilePath, unit: str | None = None, up: str | None = None) -> Calibration:
    """Read calibrated cameras, and whether their unit is known.

    Args:
        path: The file, or a folder with one of each camera.
        unit: Unit of the file's lengths: mm, cm, m, or a number of mm; None takes the unit that the file states.
        up: The axis of the file that points up, x, y, z, -x, -y or -z; the cameras are turned so that Z is. Unknown if None.

    Raises:
        InputError: As `read_cameras`; or the unit or the axis is none.
    """
    check_axis(up)
    found = _calibration(path)
    if unit is not None:
        own = MM_PER_UNIT[found.unit or _ASSUMED]
        found = Calibration(tuple(scaled(camera, mm_of_unit(unit) / own) for camera in found.cameras), unit)
    if up is not None:
        found = Calibration(tuple(with_z_up(camera, up) for camera in found.cameras), found.unit, up)
    return found


def mm_of_unit(unit: str) -> float:
    """How many mm a unit has, by its name or as a number.

    Raises:
        InputError: It is neither.
    """
    if unit in MM_PER_UNIT:
        return MM_PER_UNIT[unit]
    at = Location(field=Argument("unit"))
    try:
        mm = parse_number(unit.strip(), at)
    except InputError as error:
        raise at.error(brief(unit), f"{', '.join(MM_PER_UNIT)}, or a number of mm") from error
    if not 1e-6 <= mm <= 1e6:
        raise at.error(brief(unit), "0.000001 to 1000000 mm")
    return mm


def _calibration(path: FilePath) -> Calibration:
    source = Path(path)
    if source.is_dir():
        return _folder(source)
    suffix = source.suffix.lower()
    if suffix in PICKLES:
        return Calibration((read_opencap_camera(path),), "mm")
    if suffix in YAMLS:
        pair = {source.parent / f"{stem}{suffix}" for stem in ("intri", "extri")}
        return _folder(source.parent) if source in pair else _without_unit([read_opencv_camera(path)])
    if _starts_as_xml(path):
        return _xml(path)
    return read_toml_cameras(path)


def _xml(path: FilePath) -> Calibration:
    """Cameras of Vicon, OptiTrack or Qualisys, by the elements that a file has."""
    root, at = read_xml(path, "a calibration as Qualisys, Vicon or OptiTrack write it"), Location(path)
    if root.find(".//KeyFrame") is not None or root.find("Camera") is not None:
        return Calibration(vicon_cameras(root, at), "mm")
    if root.find(".//Extrinsic") is not None:
        return Calibration(tuple(scaled(camera, MM_PER_UNIT["m"]) for camera in optitrack_cameras(root, at)), "m")
    return Calibration(qualisys_cameras(root, at), "mm")


def _folder(folder: Path) -> Calibration:
    at = Location(folder)
    for suffix in YAMLS:
        pair = [folder / f"{stem}{suffix}" for stem in ("intri", "extri")]
        if all(file.exists() for file in pair):
            return _without_unit(read_easymocap(*pair))
    known = (*YAMLS, *PICKLES)
    listed = [*folder.glob("[!.]*"), *folder.glob("[!.]*/[!.]*.p*k*l*")]
    files = sorted(file for file in listed if file.suffix.lower() in known)
    kinds = {file.suffix.lower() in PICKLES for file in files}
    if len(kinds) != 1 or len(files) > MAX_CAMERAS:
        raise at.error("no calibration in the folder, or two kinds", _EXPECTED)
    pickled = kinds.pop()
    cameras = tuple(read_opencap_camera(file) if pickled else read_opencv_camera(file) for file in files)
    check_distinct([camera.name for camera in cameras], "cameras", at)
    return Calibration(cameras, "mm") if pickled else _without_unit(cameras)


def _without_unit(cameras: Sequence[CameraRecord]) -> Calibration:
    return Calibration(tuple(scaled(camera, MM_PER_UNIT[_ASSUMED]) for camera in cameras), None)


def _starts_as_xml(path: FilePath) -> bool:
    start = read_bytes(path, max_bytes=2**26, first=64).replace(b"\0", b"")  # UTF-16, too
    return start.lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n").startswith(b"<")


def write_cameras(path: FilePath, cameras: Sequence[CameraRecord]) -> None:
    """Write cameras in our own form, atomically; reading gives the same numbers back.

    Args:
        path: The TOML file.
        cameras: The cameras, each with a name of its own.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    lines = ['units = "mm"']
    for camera in cameras:
        lines += ["", f"[camera.{quoted(camera.name)}]", f"size = [{camera.size[0]}, {camera.size[1]}]"]
        for field in ("matrix", "distortion", "rotation", "translation"):
            lines.append(f"{field} = {np.asarray(getattr(camera, field), dtype=np.float64).tolist()!r}")
        lines += ["fisheye = true"] if camera.fisheye else []
    write_atomically(path, "\n".join(lines) + "\n")


def quoted(text: str) -> str:
    """A TOML string; what is no Unicode, as a file's name may be, becomes question marks."""
    known = text.encode("utf-8", "replace").decode("utf-8")
    return json.dumps(known, ensure_ascii=False).replace("\x7f", "\\u007f")


def read_toml_cameras(path: FilePath) -> Calibration:
    """Read the cameras of a TOML file.

    Raises:
        InputError: The file is no TOML, holds no camera, or a field is missing or malformed; the message names the field.
    """
    document, at = read_toml(path), Location(path)
    ours = document.get("camera")
    prefix, tables = _tables(document)
    if not tables or len(tables) > MAX_CAMERAS:
        raise at.error("the file has no camera", "a table [camera.NAME], anipose's [cam_0], or Caliscope's [cameras.0]")
    unit = _unit(document, "mm" if ours is not None else "m" if prefix == "cameras." else None)
    scale = mm_per_unit(unit or "m", at.in_field("units"))
    cameras = tuple(
        _camera(at.in_field(f"{prefix}{key}"), key, table, scale, ours is not None) for key, table in tables.items()
    )
    check_distinct([camera.name for camera in cameras], "cameras", at.in_field("name"))
    return Calibration(cameras, unit)


def _tables(document: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """The tables of the cameras by name, and what stands before their names."""
    for key in ("camera", "cameras"):
        group = document.get(key)
        if group is not None and not (isinstance(group, dict) and "matrix" in group):
            known = group if isinstance(group, dict) else {}
            # Caliscope keeps excluded cameras, without a pose.
            return f"{key}.", known if key == "camera" else {
                name: table for name, table in known.items() if not _ignored(table)
            }
    return "", {key: table for key, table in document.items() if isinstance(table, dict) and "matrix" in table}


def _ignored(table: object) -> bool:
    return isinstance(table, dict) and table.get("ignore") is True


def _unit(document: Mapping[str, Any], default: str | None) -> Any:
    metadata = document.get("metadata")
    unit = document.get("units", metadata.get("units") if isinstance(metadata, dict) else None)
    return default if unit is None else unit


def _camera(at: Location, key: str, table: object, scale: float, strict: bool) -> CameraRecord:
    longest = max(map(len, (key, *(table if isinstance(table, dict) else ()))))
    if longest > LONGEST:
        raise at.in_field(str(at.field)).error(f"a name of {longest} characters", f"at most {LONGEST}")
    if not isinstance(table, dict):
        raise at.error("not a table", f"[{at.field}]")

    def of(field: str) -> Location:
        return at.in_field(f"{at.field}.{field}")

    fisheye = table.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise of("fisheye").error(brief(fisheye), "true or false")
    known = {"name", "size", "matrix", "distortion", "distortions", "rotation", "translation", "fisheye"}
    unknown = sorted(set(table) - known - {"moving", "framerate"}) if strict else []
    if unknown:
        raise of(unknown[0]).error("unknown field", ", ".join(sorted(known)))
    name = table.get("name", key)
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST:
        raise of("name").error("not a name", f"a text of at most {LONGEST} characters")
    fields = {field: (of(field), table.get(field)) for field in ("matrix", "rotation", "translation", "size")}
    distortion = "distortions" if "distortions" in table else "distortion"
    fields["distortion"] = of(distortion), table.get(distortion)
    return scaled(camera_of_fields(name, **fields, fisheye=fisheye), scale)


PICKLES = (".pickle", ".pkl")
_GENERIC = "cameraIntrinsicsExtrinsics"


def read_opencap_camera(path: FilePath) -> CameraRecord:
    """Read one camera, named after its file, or its folder where the file has OpenCap's own name.

    The file, ``Videos/Cam0/cameraIntrinsicsExtrinsics.pickle``, holds ``intrinsicMat`` (3 x 3), ``distortion`` (5),
    ``imageSize`` (height, width), ``rotation`` (3 x 3) and ``translation``, mm. Nothing of the pickle is run, see
    :mod:`poseppl.files.plain_pickle`.

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
