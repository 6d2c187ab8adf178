"""Simulated detections of a person whose motion is known: keypoints of several cameras, with a detector's faults.

Points are drawn from the tracker's own programs. Offsets from the joints, autocorrelated errors, Student-t errors and noise by
confidence come from ``poseppl_models.bodies.detected_points``, clutter from ``poseppl_models.bodies.named_points``. Errors of
the cameras' poses come from the prior of their refinement, and exchanged limbs from the chain that detects them. The programs
have no distribution of confidences and gaps; these are our choice. So is the size of the cameras' errors, a third of their
prior's: at its full size, rays of one person pass each other farther away than rays of different people may.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.detected_points import FREEDOM
from poseppl_models.bodies.named_points import clutter_log_odds
from scipy.special import expit, logit

from poseppl.arrays import Booleans, Floats
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import project
from poseppl.motion.geometry.cameras import moved_cameras
from poseppl.motion.io import CameraRecord, DetectedPeople
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.camera_refinement import PRIOR_ANGLE, PRIOR_POSITION
from poseppl.motion.keypoints.limb_continuity import limb_pairs
from poseppl.motion.points.swaps import LASTS, SHARE
from poseppl.motion.tracking.lasting_errors import ERROR_SHARE, ERRORS_LAST, SHIFT, SHIFTS_LAST
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.scene import noise_of

LAYOUT = "body25"
CALIBRATION = 1 / 3
"""Size of the errors of the cameras' poses in units of their prior's 1 degree and 30 mm about each axis; ours."""
GAP_SHARE, GAPS_LAST = 0.05, 0.2
"""Share of the time in which a camera's point is not found, and seconds that this lasts; ours."""
CONFIDENCE = (8.0, 2.0)
"""Parameters of the beta distribution of confidences; our choice."""
CLUTTER = {"clutter": -5.0, "clutter_slope": -0.7}
"""Prior means of ``poseppl_models.bodies.named_points``."""


class Detected(NamedTuple):
    """Detections of a person, and the truth behind them.

    Attributes:
        people: By camera.
        places: (T, K, 3) mm, where the body's markers were.
        swaps: (T, C, P) whether the limbs of a pair were exchanged.
    """

    people: dict[str, DetectedPeople]
    places: Floats
    swaps: Booleans


def lasting(rng: np.random.Generator, count: int, shape: tuple[int, ...], lasts: float, rate: float) -> Floats:
    """Autoregressive sequences (T, ...) of variance 1."""
    kept = np.exp(-1 / rate / lasts)
    values = [rng.standard_normal(shape)]
    for _ in range(1, count):
        values.append(kept * values[-1] + np.sqrt(1 - kept**2) * rng.standard_normal(shape))
    return np.stack(values)


def spells(rng: np.random.Generator, count: int, shape: tuple[int, ...], share: float, lasts: float, rate: float) -> Booleans:
    """Two-state chains (T, ...): whether what has a share of the time and goes on for some seconds is the case."""
    kept = np.exp(-1 / rate / lasts)
    values = [rng.random(shape) < share]
    for _ in range(1, count):
        values.append(rng.random(shape) < share * (1 - kept) + kept * values[-1])
    return np.stack(values)


def detect(
    subject: MovingSubject,
    records: list[CameraRecord],
    rng: np.random.Generator,
    *,
    beside: float = SHIFT,
    calibration: float = CALIBRATION,
    clutter: bool = True,
    exchange: bool = True,
) -> Detected:
    """Draw what a detector finds of a person.

    Args:
        subject: The person.
        records: The calibrated cameras; those that see the person differ from them.
        rng: Random numbers.
        beside: Standard deviation of the markers' places beside the joints, mm.
        calibration: Size of the cameras' errors in units of their prior's.
        clutter: Whether points may be anywhere in the picture.
        exchange: Whether limbs may be exchanged.
    """
    names, rate = subject.body.tree.marker_names, subject.rate
    calibrated, count, cameras = cameras_of_records(records), len(subject.frames), len(records)
    turns, moves = (calibration * scale * rng.standard_normal((cameras, 3)) for scale in (PRIOR_ANGLE, PRIOR_POSITION))
    true = moved_cameras(calibrated, jnp.asarray(turns, float), jnp.asarray(moves, float))
    places = subject.complete_markers() + beside * lasting(rng, count, (len(names), 3), SHIFTS_LAST, rate)
    clean = np.moveaxis(np.asarray(project(true, jnp.asarray(places, float)), np.float64), 0, 1)
    sure = rng.beta(*CONFIDENCE, clean.shape[:-1])
    sizes = np.array([record.size for record in records], float)[:, None]
    scale = (noise_of(subject.body, calibrated, None) / np.sqrt(sure))[..., None]
    slow = lasting(rng, count, clean.shape[1:], ERRORS_LAST, rate)
    quick = rng.standard_normal(clean.shape) / np.sqrt(rng.chisquare(FREEDOM, clean.shape[:-1]) / FREEDOM)[..., None]
    points = clean + scale * (np.sqrt(ERROR_SHARE) * slow + np.sqrt(1 - ERROR_SHARE) * quick)
    wrong = rng.random(sure.shape) < expit(np.asarray(clutter_log_odds(_floats(CLUTTER), jnp.asarray(logit(sure), float))))
    points = np.where(clutter & wrong[..., None], rng.random(points.shape) * sizes, points)
    outside = np.any((points < 0) | (points > sizes), -1)
    points[outside | spells(rng, count, sure.shape[1:], GAP_SHARE, GAPS_LAST, rate)] = np.nan
    pairs = limb_pairs(names)
    swaps = exchange & spells(rng, count, (cameras, len(pairs)), SHARE, LASTS, rate)
    for number, (left, right) in enumerate(pairs.values()):
        swapped, (ours, others) = swaps[..., number], ([*left, *right], [*right, *left])
        for values in (points, sure):
            values[:, :, ours] = np.where(_as(swapped, values), values[:, :, others], values[:, :, ours])
    sure = np.where(np.isfinite(points).all(-1), sure, 0.0)
    people = {record.name: _people(points[:, c], sure[:, c], names) for c, record in enumerate(records)}
    return Detected(people, places, swaps)


def _as(flags: Booleans, values: Floats) -> Booleans:
    """Flags (T, C) with the axes of values (T, C, ...)."""
    return flags.reshape(*flags.shape, *(1,) * (values.ndim - 2))


def _floats(values: dict[str, float]) -> dict[str, Any]:
    return {name: jnp.asarray(value, float) for name, value in values.items()}


def _people(points: Floats, sure: Floats, names: tuple[str, ...]) -> DetectedPeople:
    """One person (T, K) in the detector's layout, which has some of the body's markers."""
    layout = LAYOUTS[LAYOUT]
    into = {name: number for name, number in markers_of_names(layout).items() if name in names}
    of, to = [names.index(name) for name in into], list(into.values())
    laid = np.full((len(points), 1, len(layout), 2), np.nan)
    confidence = np.zeros(laid.shape[:3])
    laid[:, 0, to], confidence[:, 0, to] = points[:, of], sure[:, of]
    return DetectedPeople(laid, confidence, np.arange(len(points)), LAYOUT, layout)
