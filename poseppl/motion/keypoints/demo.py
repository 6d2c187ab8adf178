"""A recording to try poseppl with: a walk, what a detector finds of it in four cameras, and the truth.

The built-in walk (:mod:`poseppl_models.bodies.gait`) has no feet. Its ankles turn here as people's do from one heel strike to
the next (:data:`ANKLE`). A heel strikes when the ankle is farthest in front of the pelvis. The detections are drawn by
:mod:`poseppl.motion.keypoints.drawn_detections`.
"""

from __future__ import annotations

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.footed import footed_body
from poseppl_models.bodies.gait import walk
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.bodies.opensim import opensim_coordinates, opensim_values
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.io import DetectedPeople
from poseppl.motion.io.cameras import write_cameras
from poseppl.motion.io.motion import Motion
from poseppl.motion.io.opensim_files import write_mot
from poseppl.motion.io.trc import write_trc
from poseppl.motion.keypoints.drawn_detections import detect
from poseppl.motion.tracking.placing import cameras_around, records_of_cameras

ANKLE = ((0, 0.0), (7, -5.0), (25, 4.0), (45, 10.0), (55, 0.0), (62, -17.0), (72, -8.0), (85, 1.0), (95, 1.0))
"""Per cent of the gait cycle, and degrees of dorsiflexion: the shape of normal gait, as textbooks draw it (Winter,
*Biomechanics and Motor Control of Human Movement*, 2009, doi:10.1002/9780470549148), chosen here to some degrees."""
FOCAL, SIZE = 1100.0, (1920, 1080)
"""Focal length and picture size of the cameras, px."""
LONGEST = 60.0
"""Seconds."""


def demo_walk(seconds: float, rate: float) -> MovingSubject:
    """The walk of a body with feet.

    Args:
        seconds: How long.
        rate: Frames a second.
    """
    count = max(2, round(seconds * rate))
    states, lengths = walk(rate, count)
    body = footed_body(lengths)
    whole = np.zeros((count, body.tree.dimension))
    whole[:, : states.shape[1]] = states  # its coordinates come first
    long = walk(rate, max(count, round(4 * rate))).states  # of several cycles, to find their phase
    for side in "lr":
        phase = _cycle_phase(footed_body(lengths).places(np.pad(long, ((0, 0), (0, 4)))), body.tree.marker_names, side)
        whole[:, body.tree.coordinates.index((f"ankle_{side}", "X"))] = _ankle(phase[:count])
    return MovingSubject(body, whole, body.places(whole), None, np.arange(count), rate, "the demo's walk")


def _cycle_phase(places: Floats, names: tuple[str, ...], side: str) -> Floats:
    """Share of the gait cycle (T,) since the side's heel strike, of a walk along x."""
    ahead = places[:, names.index(f"ankle_{side}"), 0] - places[:, names.index("pelvis"), 0]
    strikes, _ = find_peaks(ahead)
    period = float(np.mean(np.diff(strikes)))
    return np.asarray((np.arange(len(ahead)) - strikes[0]) / period % 1.0)


def _ankle(phase: Floats) -> Floats:
    """Flexion, radians, at shares of the gait cycle."""
    when, degrees = np.array([*ANKLE, (100, ANKLE[0][1])]).T
    return np.asarray(np.deg2rad(CubicSpline(when / 100, degrees, bc_type="periodic")(phase)))


def write_demo(folder: FilePath, *, seconds: float = 3.0, rate: float = 60.0, seed: int = 0) -> dict[str, Path]:
    """Write a recording of four cameras; the same again for the same arguments.

    Args:
        folder: A new folder.
        seconds: How long the person walks, at least half a second.
        rate: Frames a second.
        seed: Seed of the detector's errors.

    Returns:
        Folders of OpenPose's JSON files (BODY_25) by camera; ``Calib.toml``, the calibration, which is a little wrong;
        ``truth.trc`` and ``truth.mot``, the true places (mm, Y up) and angles, as ``poseppl export`` writes estimates.

    Raises:
        InputError: The folder holds files, or a number is out of range.
        PosepplError: The disk is full.
    """
    target = Path(folder)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise InputError("there are files already", file=target, expected="a new folder, since nothing is replaced")
    for name, value, low, high in (("seconds", seconds, 0.5, LONGEST), ("rate", rate, 10.0, 240.0)):
        if not low <= value <= high:
            raise InputError(f"{value:g}", field=Argument(name), expected=f"{low:g} to {high:g}")
    subject = demo_walk(seconds, rate)
    records = list(records_of_cameras(cameras_around(subject, count=4), FOCAL, SIZE))
    detected = detect(subject, records, np.random.default_rng(seed))
    target.mkdir(parents=True, exist_ok=True)
    written = {name: target / name for name in detected.people}
    for name, people in detected.people.items():
        _write_openpose(written[name], name, people)
    written |= {name: target / name for name in ("Calib.toml", "truth.trc", "truth.mot")}
    write_cameras(written["Calib.toml"], records)
    times, body = subject.frames / rate, subject.body
    truth = Motion(body.tree.marker_names, subject.markers, (), rate, subject.source)
    write_trc(written["truth.trc"], truth, times, subject.frames)
    coordinates = opensim_coordinates(body)
    angles = np.asarray(opensim_values(body, jnp.asarray(subject.states, float)), np.float64)
    columns = {each.name: np.unwrap(values, period=360.0) for each, values in zip(coordinates, angles.T, strict=True)}
    write_mot(written["truth.mot"], times, columns, [each.description for each in coordinates])
    return written


def _write_openpose(folder: Path, camera: str, people: DetectedPeople) -> None:
    """A JSON file a frame; a point that was not found is 0, 0 with confidence 0."""
    folder.mkdir()
    seen = np.isfinite(people.points).all(-1, keepdims=True)
    table = np.where(seen, np.concatenate([people.points, people.confidence[..., None]], -1), 0.0)
    for frame, found in zip(people.frames, table, strict=True):
        document = {"people": [{"pose_keypoints_2d": person.round(3).ravel().tolist()} for person in found]}
        with atomic_path(folder / f"{camera}_{frame:012d}_keypoints.json") as temporary:
            temporary.write_text(json.dumps(document), encoding="utf-8")
