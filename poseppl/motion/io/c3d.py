"""Marker trajectories of optical motion capture (C3D), through the library ezc3d in a process of its own (see `c3d_worker`).

Only real markers are kept. Left out: the channels that POINT:ANGLES, FORCES, MOMENTS, POWERS and the like name, unlabelled
trajectories ("*12"), the segment frames that Plug-in Gait stores as four points each (LFEO, LFEA, LFEL, LFEP) and its centre of
mass, and points that no frame shows.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, PosepplError
from poseppl.motion.io import c3d_worker
from poseppl.motion.io.c3d_layout import check_layout
from poseppl.motion.io.motion import Motion, to_z_up
from poseppl.motion.io.text_parsing import LARGEST, check_distinct

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4}
WORKER_SECONDS = 300
_Texts = dict[str, list[str]]
_MODELLED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS", "BONES")


def read_c3d(path: FilePath, *, up: str | None = None) -> Motion:
    """Read the markers of a C3D file.

    Args:
        path: The .c3d file.
        up: The axis that points up, "x", "y" or "z"; by default what POINT:Y_SCREEN says, else "z".

    Returns:
        The motion, Z up, in mm: a cloud of markers without parents; NaN where a marker was not seen.

    Raises:
        InputError: The file is malformed, its unit is unknown, or it holds no marker.
        PosepplError: ezc3d is not installed.
    """
    layout, at = check_layout(path), Location(path)
    points, texts = _run_worker(path, layout.turned)
    labels = _labels(texts)
    if points.ndim != 3 or points.shape[1:] != (layout.points, layout.frames) or len(labels) < layout.points:
        problem = f"{len(labels)} labels for data of shape {points.shape}"
        raise at.in_field("POINT").error(problem, f"{layout.points} points in {layout.frames} frames")
    positions = np.moveaxis(points[:3], 0, -1).swapaxes(0, 1) * _unit(at, texts)
    labels = labels[: layout.points]
    modelled = _modelled(texts, labels)
    kept = [index for index, label in enumerate(labels) if label and label not in modelled]
    kept = [index for index in kept if np.isfinite(positions[:, index]).all(axis=-1).any()]
    names = tuple(labels[index] for index in kept)
    at_labels = at.in_field("POINT:LABELS")
    if not names:
        raise at_labels.error("the file holds no marker")
    check_distinct(names, "markers", at_labels)
    markers = _clean(at, positions[:, kept])
    return to_z_up(Motion(names, markers, (), layout.rate, up or _up(at, texts), str(path)))


def _run_worker(path: FilePath, turned: bytes | None) -> tuple[Floats, _Texts]:
    at = Location(path)
    if importlib.util.find_spec("ezc3d") is None:
        raise PosepplError("reading .c3d files needs ezc3d: pip install 'poseppl[mocap]'")
    with tempfile.TemporaryDirectory(prefix="poseppl-") as folder:
        target, source = Path(folder) / "points.npz", Path(path).resolve()
        if turned is not None:
            source = Path(folder) / "turned.c3d"
            source.write_bytes(turned)
        # One thread: the threads of a linear algebra library reserve more memory than the limit on a large machine.
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-P", c3d_worker.__file__, str(source), str(target)]
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=WORKER_SECONDS, check=False)
        except subprocess.TimeoutExpired as error:
            raise at.error(f"ezc3d did not end within {WORKER_SECONDS} s") from error
        if done.returncode < 0:
            raise at.error("ezc3d crashed on it; the file is damaged", "a valid C3D file")
        if done.returncode or not target.is_file():
            reason = done.stderr.decode("utf-8", "replace").strip().split("\n")[-1]
            raise at.error(f"ezc3d refuses it: {reason[:300]}")
        with np.load(target, allow_pickle=False) as arrays:
            texts: _Texts = json.loads(arrays["texts"].tobytes())
            return np.asarray(arrays["points"], dtype=np.float64), texts


def _labels(texts: _Texts) -> list[str]:
    # More than 255 points go on in LABELS2, LABELS3, ...
    labels: list[str] = []
    number = 1
    while (part := texts.get("LABELS" if number == 1 else f"LABELS{number}")) is not None:
        labels += part
        number += 1
    return labels


def _modelled(texts: _Texts, labels: list[str]) -> set[str]:
    known = set(labels)
    names = {name for kind in _MODELLED for name in texts.get(kind, ())}
    names |= {label for label in labels if label.startswith(("*", "CentreOfMass"))}
    for stem in {label[:-1] for label in labels if label.endswith("O")}:
        quadruple = {stem + letter for letter in "OALP"}
        names |= quadruple if quadruple <= known else set()
    return names


def _unit(at: Location, texts: _Texts) -> float:
    units = texts.get("UNITS", [])
    unit = units[0].lower() if units else "mm"
    if unit not in MM_PER_UNIT:
        raise at.in_field("POINT:UNITS").error(f"unit {unit[:20]!r}", ", ".join(MM_PER_UNIT))
    return MM_PER_UNIT[unit]


def _up(at: Location, texts: _Texts) -> str:
    screen = "".join(texts.get("Y_SCREEN", [])).lower()
    if not screen:
        return "z"
    if screen not in ("+x", "+y", "+z"):
        expected = "+X, +Y or +Z; give the axis that points up explicitly"
        raise at.in_field("POINT:Y_SCREEN").error(f"the screen's vertical is {screen[:20]!r}", expected)
    return screen[1]


def _clean(at: Location, positions: Floats) -> Floats:
    if np.any(np.abs(positions[np.isfinite(positions)]) > LARGEST) or np.any(np.isinf(positions)):
        raise at.in_field("data").error("a position is infinite or beyond 1e9 mm")
    # A marker is seen or not: one missing coordinate takes the others with it.
    return np.where(np.isfinite(positions).all(axis=-1, keepdims=True), positions, np.nan)
