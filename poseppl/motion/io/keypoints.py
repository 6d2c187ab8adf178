"""Keypoints of any detector that is known: what a file is, is found from its content."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Location, Phrase, brief
from poseppl.files.bounded_reading import read_bytes
from poseppl.files.csv_fields import rows_of_csv
from poseppl.files.hdf5_reading import SIGNATURE, open_hdf5
from poseppl.motion.io import json_detectors
from poseppl.motion.io.deeplabcut import read_deeplabcut_csv, read_deeplabcut_h5
from poseppl.motion.io.detections import DetectedPeople
from poseppl.motion.io.detector_arrays import read_freemocap, read_sleap
from poseppl.motion.io.detector_tables import read_caliscope_points, read_ultralytics
from poseppl.motion.io.json_detectors import is_vitpose, read_alphapose, read_mmpose, read_openpose, read_vitpose
from poseppl.motion.io.json_people import numbered_files, read_json
from poseppl.motion.io.keypoint_layouts import check_layout
from poseppl.motion.io.mediapipe import read_mediapipe

DETECTORS: Mapping[str, str] = {
    "openpose": "a folder of OpenPose's JSON files, one a frame",
    "alphapose": "AlphaPose's JSON file",
    "mmpose": "MMPose's JSON file, or a folder of one a frame",
    "mediapipe": "MediaPipe's 33 landmarks, JSON or CSV",
    "deeplabcut": "DeepLabCut's or Lightning Pose's table, CSV or H5",
    "sleap": "SLEAP's analysis file, H5",
    "caliscope": "Caliscope's table of all cameras, CSV",
    "ultralytics": "a folder of Ultralytics' text files, one a frame",
    "vitpose": "easy_ViTPose's JSON file",
    "freemocap": "FreeMoCap's array of all cameras, npy",
}


def read_keypoints(
    path: FilePath,
    detector: str | None = None,
    *,
    layout: str | None = None,
    size: tuple[int, int] | None = None,
    camera: str | None = None,
    cameras: Sequence[str] = (),
) -> DetectedPeople:
    """Read one camera's keypoints.

    Args:
        path: The file or folder.
        detector: Program that wrote it, a key of :data:`DETECTORS`; detected from its content if None.
        layout: Which points of people these are; found from them if None.
        size: Width and height of the pictures, for coordinates that are shares of them.
        camera: Which camera of a table or an array of all cameras is meant.
        cameras: All cameras of the calibration, in the order of the array.

    Raises:
        InputError: The file is missing, malformed, of an unknown kind, or does not hold the camera.
    """
    kind = detector_of(path) if detector is None else detector
    match kind:
        case "openpose":
            return read_openpose(path, layout)
        case "alphapose":
            return read_alphapose(path, layout)
        case "mmpose":
            return read_mmpose(path, layout)
        case "ultralytics":
            return read_ultralytics(path, layout, size)
        case "vitpose":
            return read_vitpose(path, layout)
        case "freemocap":
            found = read_freemocap(path, camera, cameras)
        case "mediapipe":
            found = read_mediapipe(path, size)
        case "deeplabcut":
            found = read_deeplabcut_h5(path) if _is_hdf5(path) else read_deeplabcut_csv(path)
        case "sleap":
            found = read_sleap(path)
        case "caliscope":
            found = _camera_of(read_caliscope_points(path), camera, Location(path))
        case _:
            raise InputError(brief(kind), field=Argument("detector"), expected=", ".join(DETECTORS))
    if layout is not None and layout != found.layout:
        chosen = check_layout(layout, len(found.names), Location(path))
        raise InputError(f"{kind} names its points, which are not {chosen}", field=Argument("layout"), expected="none")
    return found


def read_frame(path: FilePath, detector: str | None = None) -> list[Floats]:
    """Read one frame's people, each (K, 3): x, y, confidence.

    Args:
        path: The file.
        detector: Program that wrote it, openpose or mmpose; detected from its content if None.

    Raises:
        InputError: The file is missing or malformed, or not whole.
    """
    document, at = read_json(path), Location(path)
    if detector == "openpose" or (detector is None and _is_openpose(document)):
        return json_detectors.openpose_people(document, at)
    return json_detectors.mmpose_people(document, at)


def detector_of(path: FilePath) -> str:
    """Detect the program that wrote a file or a folder, a key of :data:`DETECTORS`, from its content.

    Raises:
        InputError: It is missing, unreadable, or of no kind that is known.
    """
    at = Location(path)
    expected = "; ".join(DETECTORS.values())
    if Path(path).is_dir():
        if not any(Path(path).glob("[!.]*.json")) and any(Path(path).glob("[!.]*.txt")):
            return "ultralytics"
        first = next(iter(numbered_files(path, expected).files.values()))
        return "openpose" if _is_openpose(read_json(first)) else "mmpose"
    if _is_hdf5(path):
        with open_hdf5(path, expected) as file:
            return "sleap" if "tracks" in file and "node_names" in file else "deeplabcut"
    suffix = Path(path).suffix.lower()
    if suffix == ".npy":
        return "freemocap"
    kind = _kind_of_csv(path) if suffix == ".csv" else _kind_of_json(read_json(path)) if suffix == ".json" else None
    if kind is None:
        raise at.error("no keypoints of a detector that is known", Phrase(f"{expected}; ", Argument("detector"), " says which"))
    return kind


def _is_openpose(document: Any) -> bool:
    return isinstance(document, dict) and ("people" in document or "instance_info" not in document)


def _is_hdf5(path: FilePath) -> bool:
    return read_bytes(path, max_bytes=2**40, first=len(SIGNATURE)) == SIGNATURE


def _kind_of_csv(path: FilePath) -> str | None:
    _, header = next(rows_of_csv(path), (None, [""]))
    words = {word.lower() for word in header}
    if header[0].lower() == "scorer":
        return "deeplabcut"
    if "sync_index" in words:
        return "caliscope"
    return "mediapipe" if words & {"frame", "frame_id", "frame_number", "frame_index"} else None


def _kind_of_json(document: Any) -> str | None:
    frames = document.get("frames") if isinstance(document, dict) else document
    if isinstance(document, dict) and "instance_info" in document:
        return "mmpose"
    if is_vitpose(document):
        return "vitpose"
    first = frames[0] if isinstance(frames, list) and frames else None
    if isinstance(first, dict):
        if "image_id" in first:
            return "alphapose"
        return "mmpose" if "instances" in first else "mediapipe"
    if isinstance(first, list):
        return "mmpose" if not first or (isinstance(first[0], dict) and "keypoints" in first[0]) else "mediapipe"
    return None


def _camera_of(found: Mapping[str, DetectedPeople], camera: str | None, at: Location) -> DetectedPeople:
    if camera is None or camera not in found:
        raise at.error(f"no points of the camera {camera!r}", ", ".join(found))
    return found[camera]
