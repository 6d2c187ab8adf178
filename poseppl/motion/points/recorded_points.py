r"""Points of a recording smoothed under params that are known, each by itself, with NumPy: nothing is compiled.

The model is that of ``poseppl_models.bodies.named_points``. The state of a point is here x = (position, velocity,
autocorrelated errors, biases), the last two (C, 2) each. Its mode is sought by damped Gauss-Newton steps of the quadratic that
touches the errors' potential from above, as by :func:`poseppl.motion.points.fit.points_mode`: first with errors that are nearly
Gaussian, then with Student-t ones, then with clutter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from poseppl_models.bodies.named_points import CONFIDENCE, DRIFT
from scipy.special import expit

from poseppl.arrays import Booleans, Floats
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.geometry.recorded_frames import image_points, image_slopes
from poseppl.motion.points.fit import GAUSSIAN, NO_CLUTTER
from poseppl.motion.points.named_points import FREEDOM, START_SCALE, PointRecording, filled, local_frame, logits
from poseppl.motion.points.swaps import SeenPoints

_STEPS = 2, 3, 5
"""Steps at most, of each of three climbs."""
_NOTHING = 0.01
"""Nats that a point's step has to promise."""
_SHORTER = (0.5, 0.2, 0.05, 0.01)
"""Multiples of a step that are tried if it gains nothing."""
_ROOM = 2**28
"""Bytes of matrices of the points that are smoothed together."""


class KnownErrors(NamedTuple):
    """Params of the programs that are known, lengths in mm.

    Attributes:
        size: Scale of each camera's errors at a confidence of 0.95, px (C,).
        speed: Speeds of the points, mm a second (K,).
        speed_lasts: Seconds.
        slope: Change of the log scale with the confidence's logit.
        clutter: Log-odds of clutter at that confidence.
        clutter_slope: Their change with the logit.
        bias: Standard deviation of the biases, in units of the scale; that of the autocorrelated errors is the scale.
        lasts: Seconds that these last.
    """

    size: Floats
    speed: Floats
    speed_lasts: float
    slope: float
    clutter: float
    clutter_slope: float
    bias: float
    lasts: float


class _Walk(NamedTuple):
    """Innovations of K points: own x_t - before x_(t-1), (K, n, n) each, and first (x_0 - mean), (K, n) each."""

    own: Floats
    before: Floats
    first: Floats
    mean: Floats

    def innovations(self, x: Floats) -> Floats:
        """Compute those of trajectories (T, K, n)."""
        found = np.empty_like(x)
        found[0] = self.first * (x[0] - self.mean)
        found[1:] = _times(self.own, x[1:]) - _times(self.before, x[:-1])
        return found

    def of_points(self, part: slice) -> _Walk:
        """Take some of the points."""
        return _Walk(*(each[part] for each in self))


class _Data(NamedTuple):
    """Detections of K points in T frames: points (T, C, K, 2), known and scale (T, C, K).

    ``odds`` are log-odds of clutter, less the log of the picture's size.

    ``lasting`` and ``bias`` (C,) are standard deviations, px.
    """

    cameras: Cameras
    points: Floats
    known: Booleans
    scale: Floats
    odds: Floats
    lasting: Floats
    bias: Floats

    def of_points(self, part: slice) -> _Data:
        """Take some of the points."""
        cut: Any = {name: getattr(self, name)[:, :, part] for name in ("points", "known", "scale", "odds")}
        return self._replace(**cut)

    def wrong(self, x: Floats) -> Floats:
        """Autocorrelated errors and biases of states (T, K, n), px (T, C, K, 2)."""
        errors, biases = (part.reshape(*x.shape[:2], -1, 2) for part in np.split(x[..., 6:], 2, -1))
        return np.moveaxis(self.lasting[:, None] * errors + self.bias[:, None] * biases, 1, 2)

    def seen(self, x: Floats) -> Floats:
        """Image points (T, C, K, 2) of states (T, K, n)."""
        return np.swapaxes(image_points(self.cameras, x[..., :3]), 0, 1) + self.wrong(x)


class _Errors(NamedTuple):
    """Student-t errors of ``freedom`` degrees, with clutter or without."""

    freedom: float
    clutter: bool

    def weights(self, data: _Data, off: Floats) -> tuple[Floats, Floats]:
        """Log-densities (T, C, K) of residuals (T, C, K, 2), and weights of their squares; 0 of what is not known."""
        squared = np.square(off / data.scale[..., None]).sum(-1)
        peak = -0.5 * (self.freedom + 2) * np.log1p(squared / self.freedom)
        offset = (data.odds if self.clutter else NO_CLUTTER) + np.log(2 * np.pi) + 2 * np.log(data.scale)
        weight = expit(peak - offset) * (self.freedom + 2) / (self.freedom + squared) / data.scale**2
        return np.where(data.known, np.logaddexp(peak, offset), 0.0), np.where(data.known, weight, 0.0)


def recorded_points(recording: PointRecording, errors: KnownErrors) -> SeenPoints:
    """Smooth the points of a recording at equal intervals, and predict where the cameras see them.

    Raises:
        InputError: No point is seen by two cameras at a time, or they are behind one.
    """
    places = triangulate(recording.cameras, recording.points, recording.confidence)
    frame, _ = local_frame(recording, places)
    start = filled(places, frame.origin)
    known = np.asarray(np.isfinite(recording.points).all(-1))
    above = logits(recording.confidence) - CONFIDENCE
    scale = errors.size[:, None] * np.exp(errors.slope * above)
    odds = errors.clutter + errors.clutter_slope * above
    anywhere = np.log(recording.sizes).sum(-1)[:, None]
    points = np.where(known[..., None], recording.points, 0.0)
    data = _Data(recording.cameras, points, known, scale, odds - anywhere, errors.size, errors.bias * errors.size)
    spread = START_SCALE * max(float(np.ptp(start, axis=(0, 1)).max()), 10.0 / frame.unit)
    walk = _walk(errors, float(np.median(np.diff(recording.times))), start[0], spread, len(errors.size))
    images = np.empty_like(points)
    size = walk.mean.shape[1]
    together = max(1, _ROOM // (16 * len(points) * size**2))
    for first in range(0, points.shape[2], together):
        part = slice(first, first + together)
        own, x = data.of_points(part), np.zeros((len(points), *walk.mean[part].shape))
        x[..., :3] = start[:, part]
        for kind, most in zip((_Errors(GAUSSIAN, False), _Errors(FREEDOM, False), _Errors(FREEDOM, True)), _STEPS, strict=True):
            x = _climbed(own, walk.of_points(part), kind, x, most)
        images[:, :, part] = own.seen(x)
    return SeenPoints(images, scale, odds, recording.sizes)


def _walk(errors: KnownErrors, elapsed: float, start: Floats, spread: float, num_cameras: int) -> _Walk:
    """How states walk from places (K, 3) in steps of some seconds."""
    count, size = len(start), 6 + 4 * num_cameras
    mean, lower = motion_step(elapsed, errors.speed_lasts)
    whitening, eye = np.linalg.inv(lower) / errors.speed[:, None, None], np.eye(3)
    kept = np.exp(-elapsed / errors.lasts)
    own, before = np.zeros((count, size, size)), np.zeros((count, size, size))
    own[:, :6, :6], before[:, :6, :6] = np.kron(whitening, eye), np.kron(whitening @ mean, eye)
    lasting, constant = np.arange(6, 6 + 2 * num_cameras), np.arange(6 + 2 * num_cameras, size)
    own[:, lasting, lasting], before[:, lasting, lasting] = np.array([1.0, kept]) / np.sqrt(1 - kept**2)
    own[:, constant, constant] = before[:, constant, constant] = 1 / (DRIFT * np.sqrt(elapsed))
    first, middle = np.ones((count, size)), np.zeros((count, size))
    first[:, :3], first[:, 3:6], middle[:, :3] = 1 / spread, 1 / errors.speed[:, None], start
    return _Walk(own, before, first, middle)


def motion_step(elapsed: float, tau: float) -> tuple[Floats, Floats]:
    """Matrix (2, 2) of the mean of a place and its velocity, and Cholesky factor of their covariance at speed 1.

    The formulas are those of the programs. The variance of the place is a series where its closed form cancels.
    """
    h = elapsed / tau
    kept, gone = np.exp(-h), -np.expm1(-h)
    short = h**3 * (2 / 3 - h / 2 + 7 / 30 * h**2 - h**3 / 12 + 31 / 1260 * h**4)
    place = tau * np.sqrt(short if h < 0.02 else 2 * h - 2 * gone - gone**2)
    beside = tau * gone**2 / place
    rest = np.sqrt(-np.expm1(-2 * h) - beside**2)
    return np.array([[1.0, tau * gone], [0.0, kept]]), np.array([[place, 0.0], [beside, rest]])


def _climbed(data: _Data, walk: _Walk, errors: _Errors, x: Floats, most: int) -> Floats:
    """States (T, K, n), some steps nearer to the mode of each point."""
    for _ in range(most):
        step, promised = _step(data, walk, errors, x)
        before, length = _log_density(data, walk, errors, x), np.ones(x.shape[1])
        for shorter in _SHORTER:
            fell = _log_density(data, walk, errors, x + length[:, None] * step) < before
            if not fell.any():
                break
            length[fell] = shorter
        x = x + length[:, None] * step
        if promised.max() < _NOTHING:
            break
    return x


def _log_density(data: _Data, walk: _Walk, errors: _Errors, x: Floats) -> Floats:
    """Log-densities (K,) of states (T, K, n), and a constant."""
    density, _ = errors.weights(data, data.points - data.seen(x))
    return np.asarray(density.sum((0, 1)) - 0.5 * np.square(walk.innovations(x)).sum((0, 2)))


def _step(data: _Data, walk: _Walk, errors: _Errors, x: Floats) -> tuple[Floats, Floats]:
    """A Gauss-Newton step (T, K, n), and the nats (K,) that it promises."""
    (num_frames, count, size), num_cameras = x.shape, len(data.lasting)
    seen, slopes = (np.swapaxes(each, 0, 1) for each in image_slopes(data.cameras, x[..., :3]))
    off = data.points - seen - data.wrong(x)
    root = np.sqrt(errors.weights(data, off)[1])[..., None]
    rows: Floats = np.zeros((num_frames, count, num_cameras, 2, size))
    rows[..., :3] = np.moveaxis(slopes * root[..., None], 1, 2)
    weighed = np.moveaxis(root[..., 0], 1, 2)
    for c in range(num_cameras):
        for axis in range(2):
            rows[:, :, c, axis, 6 + 2 * c + axis] = weighed[:, :, c] * data.lasting[c]
            rows[:, :, c, axis, 6 + 2 * (num_cameras + c) + axis] = weighed[:, :, c] * data.bias[c]
    rows = rows.reshape(num_frames, count, -1, size)
    force = np.moveaxis(root * off, 1, 2).reshape(num_frames, count, 1, -1)
    innovations = walk.innovations(x)
    right = (force @ rows)[:, :, 0]
    right[0] -= walk.first * innovations[0]
    right[1:] -= _times(np.swapaxes(walk.own, 1, 2), innovations[1:])
    right[:-1] += _times(np.swapaxes(walk.before, 1, 2), innovations[1:])
    step = _solved(walk, np.swapaxes(rows, -1, -2) @ rows, right)
    return step, 0.5 * np.sum(step * right, (0, 2))


def _solved(walk: _Walk, blocks: Floats, right: Floats) -> Floats:
    """P^-1 b (T, K, n) of the precision of the walk and of each frame's information (T, K, n, n), which is overwritten."""
    own, before = (np.swapaxes(each, 1, 2) @ each for each in (walk.own, walk.before))
    below = -np.swapaxes(walk.own, 1, 2) @ walk.before
    above, index = np.swapaxes(below, 1, 2), np.arange(right.shape[-1])
    blocks[0][:, index, index] += np.square(walk.first)
    blocks[1:] += own
    blocks[:-1] += before
    x = right.copy()
    for t in range(len(x)):
        if t:
            blocks[t] -= below @ blocks[t - 1]
            x[t] -= _times(below, x[t - 1])
        found = np.linalg.solve(blocks[t], np.concatenate([above, x[t][..., None]], -1))
        blocks[t], x[t] = found[..., :-1], found[..., -1]
    for t in range(len(x) - 2, -1, -1):
        x[t] -= _times(blocks[t], x[t + 1])
    return x


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Products (..., K, n) of matrices (K, n, n) with vectors (..., K, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
