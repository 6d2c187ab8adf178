"""A detector calibrated on a recording: its errors, and the coverage in each half with the errors of the other."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.special import expit

from poseppl.arrays import Floats
from poseppl.compilation import double_precision
from poseppl.motion.keypoints.detector_errors import GAUSSIAN, DetectorErrors
from poseppl.motion.keypoints.detector_fit import fit_detector
from poseppl.motion.keypoints.held_out_cameras import SeenPoints, draw_places, log_predictions, probabilities, seen_points
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from poseppl.motion.tracking.scene import MIN_CONFIDENCE

LEVELS = np.arange(1, 10) / 10
_NO_CLUTTER = -50.0


class HeldOut(NamedTuple):
    """How well what a camera sees is predicted from what the others see.

    Attributes:
        levels: (9,) share of the coordinates that intervals of 10 to 90 % hold.
        log_density: Mean log-density of a keypoint, px^-2.
    """

    levels: Floats
    log_density: float

    @property
    def ece(self) -> float:
        """Mean distance of the shares from the levels."""
        return float(np.abs(self.levels - LEVELS).mean())


class DetectorCalibration(NamedTuple):
    """The errors of a detector, and how well they do.

    Attributes:
        errors: From all frames.
        before: With a noise of each camera that grows as the root of the confidence falls.
        after: With the errors from the other half of the frames.
    """

    errors: DetectorErrors
    before: HeldOut
    after: HeldOut


def calibrate_detector(found: KeypointScene, seed: int = 0) -> DetectorCalibration:
    """Find the errors of a detector in a recording, and judge them in each half of it by those from the other.

    Args:
        found: The recording: three cameras or more.
        seed: Seed of the draws.

    Raises:
        InputError: Three cameras see too few points.
    """
    scene, markers = found.scene, found.scene.body.tree.marker_names
    source = f"{scene.source}, {len(scene.frames)} frames, {found.layout or 'named points'}"
    seen = seen_points(scene.cameras, scene.data.points, found.confidence, found.sizes)
    errors = fit_detector(seen, markers, source, seed)
    half = len(seen.marker) // 2
    halves = seen.part(slice(half)), seen.part(slice(half, None))
    before, after = [], []
    for own, other in (halves, halves[::-1]):
        scale = found.errors.scale / GAUSSIAN / np.sqrt(np.clip(expit(own.logit), MIN_CONFIDENCE, 1.0))
        before.append(judge(own, scale, np.full(scale.shape, _NO_CLUTTER), seed))
        after.append(judge(own, *errors_at(fit_detector(other, markers, source, seed), own, markers), seed))
    return DetectorCalibration(errors, _mean(before), _mean(after))


def errors_at(errors: DetectorErrors, seen: SeenPoints, markers: tuple[str, ...]) -> tuple[Floats, Floats]:
    """Scales, px, and log-odds of clutter (N, C) of points."""
    scale, odds = errors.scale_and_odds(errors.log_scales(markers)[seen.marker][:, None], seen.logit)
    return scale * seen.magnification, odds


def judge(seen: SeenPoints, scale: Floats, odds: Floats, seed: int = 0) -> HeldOut:
    """Predict each camera's points from the others'.

    Args:
        seen: The points.
        scale: (N, C) of the errors, px.
        odds: (N, C) log-odds of clutter.
        seed: Seed of the draws.
    """
    with double_precision():
        drawn = draw_places(seen, scale, np.random.default_rng(seed))
        below = probabilities(drawn, scale, odds, seen)
        log_densities = log_predictions(drawn, jnp.asarray(scale), jnp.asarray(odds), seen.seen, seen.sizes)
        total = float(log_densities.sum())
    off = np.abs(below[np.isfinite(below)] - 0.5)
    return HeldOut(np.array([(off <= level / 2).mean() for level in LEVELS]), total / seen.seen.sum())


def _mean(each: list[HeldOut]) -> HeldOut:
    return HeldOut(np.mean([one.levels for one in each], 0), float(np.mean([one.log_density for one in each])))
