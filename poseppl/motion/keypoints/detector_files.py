"""Files of a detector's errors, as poseppl calibrate-detector writes them: JSON, whole or not at all, checked when read.

{"poseppl_detector_errors": 1, "source": "...", "confidence": 0.64, "slope": -0.9, "clutter": -8.0, "clutter_slope": -0.6,
 "scale_mm": {"wrist_l": 10.8, ...}, "residuals": {"wrist_l": 400, ...}}
"""

from __future__ import annotations

import json

import numpy as np

from poseppl.errors import FilePath, Location, brief
from poseppl.files.atomic_writing import atomic_path
from poseppl.files.bounded_reading import read_json
from poseppl.motion.io.detections import MAX_POINTS
from poseppl.motion.io.text_parsing import finite_numbers, some
from poseppl.motion.keypoints.detector_errors import DetectorErrors
from poseppl.motion.points.named_points import MAX_SURE, MIN_SURE

VERSION = 1
_KIND = "poseppl_detector_errors"
_LIMITS = {"confidence": (MIN_SURE, MAX_SURE), "slope": (-10, 10), "clutter": (-50, 50), "clutter_slope": (-10, 10)}
_SCALES, _COUNTS = (1e-3, 1e4), (0, 1e9)
_FIELDS = (_KIND, "source", *_LIMITS, "scale_mm", "residuals")


def write_detector_errors(errors: DetectorErrors, path: FilePath) -> None:
    """Write the errors of a detector.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    document = {
        _KIND: VERSION,
        "source": errors.source,
        **{name: getattr(errors, name) for name in _LIMITS},
        "scale_mm": {name: float(np.exp(value)) for name, value in errors.log_scale.items()},
        "residuals": dict(errors.counts),
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def read_detector_errors(path: FilePath) -> DetectorErrors:
    """Read the errors of a detector.

    Raises:
        InputError: The file is missing, none of these, or a field is absent, unknown or out of its range; the message names it.
    """
    document, at = read_json(path), Location(path)
    if not isinstance(document, dict) or document.get(_KIND) != VERSION:
        raise at.in_field(_KIND).error("no errors of a detector", f"{VERSION}, a file of poseppl calibrate-detector")
    for name in {*document, *_FIELDS}:
        if name not in _FIELDS or name not in document:
            problem = "is unknown" if name in document else "is missing"
            raise at.error(f"the field {brief(name)} {problem}", some(_FIELDS))
    if not isinstance(document["source"], str):
        raise at.in_field("source").error("no text", "what the errors were found from")
    given = finite_numbers({name: document[name] for name in _LIMITS}, _LIMITS, at)
    for name, limits in _LIMITS.items():
        _check(given[name], limits, at.in_field(name))
    scales, counts = (_by_marker(document[name], at.in_field(name)) for name in ("scale_mm", "residuals"))
    if not scales:
        raise at.in_field("scale_mm").error("no marker", "one at least")
    for field, numbers, limits in (("scale_mm", scales, _SCALES), ("residuals", counts, _COUNTS)):
        for name, value in numbers.items():
            _check(value, limits, at.in_field(f"{field}.{name}"))
    log_scale = {name: float(np.log(value)) for name, value in scales.items()}
    return DetectorErrors(log_scale, **given, counts={name: int(n) for name, n in counts.items()}, source=document["source"])


def _by_marker(value: object, at: Location) -> dict[str, float]:
    if isinstance(value, dict) and len(value) > MAX_POINTS:
        raise at.error(f"{len(value)} markers", f"at most {MAX_POINTS}")
    return finite_numbers(value, value if isinstance(value, dict) else (), at)


def _check(value: float, limits: tuple[float, float], at: Location) -> None:
    if not limits[0] <= value <= limits[1]:
        raise at.error(f"{value:g}", f"{limits[0]:g} to {limits[1]:g}")
