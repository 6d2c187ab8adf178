"""Calibrated cameras as TOML: our own form, anipose's and Pose2Sim's, and Caliscope's; see :mod:`poseppl.motion.io.cameras`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl.errors import FilePath, Location, brief
from poseppl.files.bounded_reading import read_toml
from poseppl.motion.io.camera_fields import (
    MAX_CAMERAS,
    Calibration,
    CameraRecord,
    camera_of_fields,
    scaled,
)
from poseppl.motion.io.length_units import mm_per_unit
from poseppl.motion.io.text_parsing import LONGEST, check_distinct


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
