r"""Which detection is the person, and which of its limbs a detector took for each other: as probabilities, by camera and frame.

The programs of ``poseppl_models.bodies.named_points`` estimate the markers' positions, each marker by itself. Their errors have
heavy tails and clutter, so that an occasional wrong detection does not mislead them. Given these positions,

* each of the n detections of a camera's frame is the person's with a probability,

      P(i) \propto (1 - NOBODY) / n  p(points of i | the person's) / p(points of i | anywhere in the picture),

  or none of them is, with NOBODY;
* each pair of limbs is exchanged or not, by a Markov chain that is summed out exactly, as in
  :mod:`poseppl.motion.points.swaps`.

Another detection, or an exchange, with a probability above 0.5 is applied, and both are estimated again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import softmax
from threadpoolctl import threadpool_limits

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError, Phrase
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import DetectedPeople
from poseppl.motion.keypoints.camera_errors import camera_errors
from poseppl.motion.keypoints.limb_continuity import limb_pairs, proposed_swaps
from poseppl.motion.keypoints.sources import points_of
from poseppl.motion.points.named_points import PointRecording, local_frame
from poseppl.motion.points.recorded_points import KnownErrors, recorded_points
from poseppl.motion.points.swaps import SHARE, Pair, SeenPoints, exchanged, swap_probabilities

NOBODY = 0.05
"""Share of the frames in which none of a camera's detections is the person; ours."""
SURE = 0.9
"""Detections that are the person's with less probability are reported."""
MIN_FRAMES = 10
"""Frames, at least, of which a motion tells what is wrong."""
BIAS_SHARE = 0.25
"""Share of the errors' scale that is constant in time; our choice."""
ERRORS_LAST, SPEED_LASTS = 0.5, 0.25
"""Seconds that errors of a point and velocities last; ours."""
_CLUTTER, _CLUTTER_SLOPE, _SLOPE = -5.0, -0.7, -0.15
"""The prior means of the programs."""
_MIN_SPEED, _SPEED_OVER = 20.0, 0.1
"""Pixels a second, and seconds that a speed is measured over."""


class Association(NamedTuple):
    """Result of the association, and the points that follow from it.

    Attributes:
        points: (T, C, K, 2) of the person's detections, with exchanged limbs put right.
        confidence: (T, C, K).
        chosen: (T, C) index of the detection, -1 where there is none.
        identity: (T, C) probability that the detection is the person's; NaN where there is none.
        swaps: (T, C, P) probability that the detector exchanged the limbs of each pair.
        pairs: P names.
    """

    points: Floats
    confidence: Floats
    chosen: Integers
    identity: Floats
    swaps: Floats
    pairs: tuple[str, ...]

    def notes(self, cameras: Sequence[str], frames: Integers) -> list[str]:
        """Notes for the user, a sentence each."""
        notes: list[str] = []
        for c, camera in enumerate(cameras):
            for number, pair in enumerate(self.pairs):
                wrong = np.flatnonzero(self.swaps[:, c, number] > 0.5)
                if wrong.size:
                    notes.append(
                        Phrase(
                            f"{camera}: left and right {pair} are swapped in {wrong.size} frames ({_some(frames[wrong])}); "
                            "this is corrected (",
                            Argument("keep", "detections"),
                            " disables it)",
                        )
                    )
            doubtful = np.flatnonzero(self.identity[:, c] < SURE)
            if doubtful.size:
                notes.append(
                    f"{camera}: that its detection is the person's has a probability of less than {SURE:.0%} in "
                    f"{doubtful.size} frames ({_some(frames[doubtful])})"
                )
        return notes


def associate(
    cameras: Cameras, sizes: Floats, people: Sequence[DetectedPeople], chosen: Integers, rate: float
) -> Association | None:
    """Find the person's detections and exchanged limbs.

    Args:
        cameras: C cameras.
        sizes: (C, 2) of their pictures, px.
        people: Detections of each camera in the same T frames; its points are a body's markers.
        chosen: (T, C) about which detections are the person's.
        rate: Frames a second.

    Returns:
        The association; None if there are too few frames, or if no two cameras see the person.
    """
    points, confidence = points_of(people, chosen)
    noise = camera_errors(cameras, points, triangulate(cameras, points, confidence)).scale
    if len(points) < MIN_FRAMES or len(people) < 2 or not np.isfinite(noise).any():
        return None
    noise = np.where(np.isfinite(noise), noise, np.nanmax(noise))
    named = limb_pairs(people[0].names)
    pairs, elapsed = list(named.values()), np.full(len(points), 1 / rate)
    frames = np.arange(len(points))
    recording = PointRecording(
        people[0].names, ("",) * len(people), cameras, sizes, points, confidence, frames, frames / rate, rate, ""
    )
    try:
        seen, first = _seen_after_proposals(recording, noise, rate, pairs)
        identity = identity_probabilities(people, seen, pairs)
        better = _likeliest(identity)
        if np.any(better != chosen):
            points, confidence = points_of(people, better)
            recording = recording._replace(points=points, confidence=confidence)
            seen, first = _seen_after_proposals(recording, noise, rate, pairs)
        swaps = swap_probabilities(points, seen, pairs, elapsed)
        corrected = exchanged(points, swaps, pairs), exchanged(confidence, swaps, pairs)
        if np.any((swaps > 0.5) != (first > 0.5)):
            seen = _seen(recording._replace(points=corrected[0], confidence=corrected[1]), noise, rate)
            swaps = swap_probabilities(points, seen, pairs, elapsed)
            corrected = exchanged(points, swaps, pairs), exchanged(confidence, swaps, pairs)
    except InputError:  # a person whom no two cameras see at a time, or behind one: what follows says so
        return None
    identity = identity_probabilities(people, seen, pairs)
    own = np.take_along_axis(identity, np.maximum(better, 0)[..., None], 2)[..., 0]
    return Association(*corrected, better, np.where(better >= 0, own, np.nan), swaps, tuple(named))


def identity_probabilities(people: Sequence[DetectedPeople], seen: SeenPoints, pairs: Sequence[Pair]) -> Floats:
    """Probabilities (T, C, P) that each detection is the person's, whose limbs may be exchanged; 0 where there is none."""
    most = max(found.points.shape[1] for found in people)
    num_frames, num_cameras, num_points = seen.scales.shape
    inside = {index for pair in pairs for limb in pair for index in limb}
    rest = [index for index in range(num_points) if index not in inside]
    log_odds = np.full((num_frames, num_cameras, most), -np.inf)
    for number in range(most):
        points = np.full((num_frames, num_cameras, num_points, 2), np.nan)
        for c, found in enumerate(people):
            if number < found.points.shape[1]:
                points[:, c] = found.points[:, number]
        own = seen.log_density(points[:, :, rest], rest)
        for left, right in pairs:
            kept = seen.log_density(points[:, :, [*left, *right]], [*left, *right])
            swapped = seen.log_density(points[:, :, [*right, *left]], [*left, *right])
            own = own + np.logaddexp(np.log1p(-SHARE) + kept, np.log(SHARE) + swapped)
        count = np.isfinite(points).all(-1).sum(-1)
        anywhere = -count * np.log(seen.sizes).sum(-1)
        log_odds[..., number] = np.where(count > 0, own - anywhere, -np.inf)
    count = np.maximum(np.isfinite(log_odds).sum(-1, keepdims=True), 1)
    ours = np.log1p(-NOBODY) - np.log(count) + log_odds
    nobody = np.full((num_frames, num_cameras, 1), np.log(NOBODY))
    return np.asarray(softmax(np.concatenate([ours, nobody], -1), axis=-1)[..., :-1])


def _some(frames: Integers) -> str:
    """The first of some frame numbers."""
    return ", ".join(map(str, frames[:5])) + (", ..." if len(frames) > 5 else "")


def _likeliest(identity: Floats) -> Integers:
    """Index (T, C) of the detection that is the person's more likely than not, -1 where there is none."""
    return np.where(identity.max(-1) > 0.5, identity.argmax(-1), -1)


def _seen_after_proposals(
    recording: PointRecording, noise: Floats, rate: float, pairs: Sequence[Pair]
) -> tuple[SeenPoints, Floats]:
    """Markers as cameras see them after proposed exchanges of limbs (T, C, P) are reverted, and these proposals."""
    first = proposed_swaps(recording.cameras, recording.points, recording.confidence, pairs, rate)
    points, confidence = (exchanged(values, first, pairs) for values in (recording.points, recording.confidence))
    return _seen(recording._replace(points=points, confidence=confidence), noise, rate), first


def _seen(recording: PointRecording, noise: Floats, rate: float) -> SeenPoints:
    """Markers as cameras of some noise (C,) see them, each smoothed by itself.

    Raises:
        InputError: No marker is seen by two cameras at a time, or they are behind one.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # threads of small matrices wait for each other, and spin
        return recorded_points(recording, _errors(recording, noise, rate))


def _errors(recording: PointRecording, noise: Floats, rate: float) -> KnownErrors:
    """Errors of which half of the variance lasts, and motion about as fast as the places are."""
    places = triangulate(recording.cameras, recording.points, recording.confidence)
    over = min(max(round(_SPEED_OVER * rate), 1), len(places) - 1)
    steps: Floats = np.abs(places[over:] - places[:-over]) * rate / over
    known = np.asarray(np.isfinite(steps).all(-1))
    speed = [1.4826 * float(np.median(steps[known[:, k], k])) if known[:, k].any() else 0.0 for k in range(steps.shape[1])]
    slowest = _MIN_SPEED / local_frame(recording, places)[0].unit
    return KnownErrors(
        size=noise / np.sqrt(2),
        speed=np.maximum(speed, slowest),
        speed_lasts=SPEED_LASTS,
        slope=_SLOPE,
        clutter=_CLUTTER,
        clutter_slope=_CLUTTER_SLOPE,
        bias=BIAS_SHARE,
        lasts=ERRORS_LAST,
    )
