"""Residuals of image points: noise and bias by camera, over the frames, and in units of what they should be.

If model and posterior are right, the posterior expectation of a point's squared distance from its projection averages to the
square of its noise s (law of total variance). So for the posterior's mean m and variance v of the projection

    E[(y - m)^2] = s^2 - v.

The scale of a group of points is sqrt(sum (y - m)^2 / s^2 / sum (1 - v / s^2)): 1 when right, of filters and of smoothers, of
linear models and others. If v is close to s^2, the expected residual is close to zero. A small error of v, such as that of a
Gaussian that the projection bends, then matters more than the noise: such points are left out, and counted. They are chosen by
their spread, which in a linear Gaussian model no data change, so that the identity is valid for the others.

Detectors also report single points far from the body, which the likelihood weighs down (Student-t). A square is therefore at
most that of `LARGEST` standard deviations, by the larger of the noise and the group's median residual. A group that is far off
as a whole keeps its scale.

If the noise alone is wrong, intervals of a run of scale 1.2 are as much too narrow, and hold 83 % where they promise 90 %; at
1.1 they hold 87 %.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import log_ratio
from poseppl.diagnostics.selection import Array
from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Findings, Remedy, Verdict, not_run
from poseppl.motion.measures import mean_points
from poseppl.motion.verdicts.steps import ANGLE, POSITION, in_one_camera, of_walk
from poseppl.runs.contents import draws_of, names_of, variable
from poseppl.runs.results import provenance

MAD = 1.4826
"""Standard deviation of a normal error over the median of its absolute value."""
MIN_SHARE = 0.25
"""Share of the noise's variance below which a residual is left out: a tenth more spread would be a third less of it."""

LARGEST = 4.0
"""Residuals count up to so many standard deviations. Scales of normal errors shrink by 0.01 %, of Student-t_4 ones by 4 %."""


class ImageErrors(NamedTuple):
    """The errors of a result's cameras.

    Attributes:
        cameras: C names.
        residual: (T, C, K, 2) seen less expected, image units; NaN where a marker was not seen.
        noise: (T, C, K) standard deviations that the model was given; NaN if the result does not contain it.
        deviation: (T, C, K, 2) posterior standard deviations of the projections.
    """

    cameras: list[str]
    residual: Array
    noise: Array
    deviation: Array

    @property
    def distance(self) -> Array:
        """(T, C, K) image units."""
        return np.asarray(np.linalg.norm(self.residual, axis=-1))

    @property
    def bias(self) -> Array:
        """(C, 2) median over frames and markers; NaN for a camera that saw nothing."""
        return np.stack([_median(each.reshape(-1, 2)) for each in np.moveaxis(self.residual, 1, 0)])

    @property
    def standardised_bias(self) -> Array:
        """(C, 2) median in units of the noise; NaN for a camera that saw nothing."""
        return np.stack([_median(each.reshape(-1, 2)) for each in np.moveaxis(self.standardised, 1, 0)])

    @property
    def spread(self) -> Array:
        """(C,) robust standard deviation of a coordinate about the bias."""
        beside = np.abs(self.residual - self.bias[:, None])
        return np.stack([MAD * _median(each.reshape(-1, 1))[0] for each in np.moveaxis(beside, 1, 0)])

    @property
    def _unit(self) -> Array:
        return np.where(self.noise > 0, self.noise, np.nan)[..., None]

    @property
    def standardised(self) -> Array:
        """(T, C, K, 2) residuals in units of the noise."""
        return self.residual / self._unit

    @property
    def expected(self) -> Array:
        """(T, C, K, 2) what their squares should be on average, 1 - v / s^2; NaN where that is below `MIN_SHARE`, too."""
        share = 1 - np.square(self.deviation / self._unit)
        return np.where(np.isfinite(self.residual) & (share >= MIN_SHARE), share, np.nan)

    def scale(self, axes: tuple[int, ...] | None = None) -> Any:
        """Scale over the axes; over all if None. NaN where all are left out."""
        square, expected = self.sums(axes)
        return np.sqrt(square / np.where(expected > 0, expected, np.nan))

    def sums(self, axes: tuple[int, ...] | None = None) -> tuple[Any, Any]:
        """Squares, at most those of `LARGEST`, and what they should be, summed over the axes."""
        ratio = np.ma.masked_invalid(np.square(self.standardised) / self.expected)
        middle = np.ma.median(ratio, axis=axes, keepdims=True)  # type: ignore[no-untyped-call]
        squares = np.minimum(
            ratio.filled(0.0), LARGEST**2 * np.maximum(1.0, MAD**2 * np.ma.filled(middle, 0.0))
        ) * np.nan_to_num(self.expected)
        return squares.sum(axis=axes), np.nansum(self.expected, axis=axes)

    @property
    def left_out(self) -> float:
        """Share of the residuals of which the identity expects next to nothing."""
        seen = np.isfinite(self.standardised)
        return float(1 - np.isfinite(self.expected)[seen].mean()) if seen.any() else 0.0


def image_errors(tree: xr.DataTree) -> ImageErrors | None:
    """The errors in the images of a result; None if it has no points of markers that were seen."""
    seen, expected = variable(tree, "observed_data", "points"), mean_points(tree)
    if seen is None or expected is None or seen.shape != expected.shape or not np.isfinite(seen).any():
        return None
    noise, deviation = variable(tree, "inputs", "noise"), variable(tree, "summary", "points_sd")
    if noise is None or noise.shape != seen.shape[3 - noise.ndim : 3]:
        noise = np.full(1, np.nan)
    if deviation is None:
        draws = draws_of(tree, "points")
        deviation = np.full(1, np.nan) if draws is None else draws.std(axis=(0, 1), dtype=np.float64)
    residual, given = np.asarray(seen - expected, np.float64), np.broadcast_to(noise, seen.shape[:3])
    return ImageErrors(names_of(tree, "camera", "observed_data"), residual, given, deviation)


def _median(values: Array) -> Array:
    known = values[np.isfinite(values).all(-1)]
    return np.median(known, axis=0) if len(known) else np.full(values.shape[-1], np.nan)


SCALE_HIGH, SCALE_ERROR = 1.1, 1.2
"""Scales of all points above which their verdict is a warning, an error."""
SCALE_LOW = 0.7
MAX_LEFT_OUT = 0.5
"""Largest share of points whose posterior SD hides their noise. Above it the other points do not judge the noise either: they
are a minority, selected by a small SD, of a posterior that the projection bends."""
CAMERA_HIGH, CAMERA_ERROR = 1.15, 1.3
"""Scales of one camera that stands out, above which its verdict is a warning, an error."""
STANDS_OUT = 1.05
"""Factor by which the scale of a camera that stands out exceeds that of all points."""
MARKER_HIGH = 2.0
MAX_NAMED = 4
BIAS_HIGH = 0.7
"""Median residual of a camera, in units of its noise, from which on it is reported."""
_OF_CAMERA = (
    Remedy("check its calibration ({})", "camera"),
    Remedy("check its calibration ({})", "calibration"),
    Remedy("check its time offset, and that it shows the same person"),
)
_OF_MARKERS = (
    Remedy("check the lengths ({})", "stature"),
    Remedy("check the lengths ({})", "model"),
    Remedy("check what the detector calls these joints"),
)


def point_residuals(tree: xr.DataTree) -> Findings:
    """Points farther from the body than noise and posterior allow, or nearer; by camera and marker."""
    errors, markers = image_errors(tree), names_of(tree, "marker")
    if errors is not None and errors.cameras and markers:
        if errors.left_out > MAX_LEFT_OUT:
            share = f"for {100 * errors.left_out:.0f} % of the image points the posterior SD is larger than the noise"
            yield Verdict(INFO, f"The noise of the image points cannot be judged by their residuals: {share}.")
        else:
            yield from _overall(tree, errors, markers)
            yield from _of_markers(errors, markers)
        yield from _of_cameras(errors)
    else:
        yield not_run()


def one_camera(tree: xr.DataTree) -> Findings:
    """A detector's keypoints of a single camera, whose intervals have too low a coverage (studies/one_camera.py)."""
    if in_one_camera(tree):
        known = provenance(tree)
        remedies = [Remedy("omit {}", "walk")] if known.get("settings", {}).get("walk") != "mean-reverting" else []
        remedies += [Remedy("smooth with assumed-density")] if known.get("smoother") == "laplace" else []
        if remedies:
            text = "One camera: estimated joints tend to be too near to it, by more than the intervals allow:"
            yield Verdict(WARNING, text, (*remedies, Remedy("add a camera")))
    else:
        yield not_run()


def _overall(tree: xr.DataTree, errors: ImageErrors, markers: list[str]) -> Findings:
    scale, low, high = _interval(errors)
    text = f"Image points are {scale:.2f} times as far from the body as noise and posterior allow"
    if scale > SCALE_HIGH and low > 1:
        worst = [_largest(errors.scale((0, 1, 3)), markers)]
        if len(errors.cameras) > 1:
            worst.insert(0, _largest(errors.scale((0, 2, 3)), errors.cameras))
        text += f" (worst {', '.join(worst)}{_without(errors)})"
        remedies = Remedy("raise {} by that factor", "noise"), Remedy("correct the calibration or the lengths")
        severity = ERROR if scale > SCALE_ERROR else WARNING
        yield Verdict(severity, f"{text}:", (*remedies, *of_walk(tree, "raise {}", ANGLE, POSITION)))
    if scale < SCALE_LOW and high < 1 and not in_one_camera(tree):
        yield Verdict(WARNING, f"{text}: intervals are too wide;", (Remedy("lower {} by that factor", "noise"),))


def _of_cameras(errors: ImageErrors) -> Findings:
    """Cameras that stand out among others, by scale or by median."""
    if len(errors.cameras) < 2:
        return
    scales = errors.scale((0, 2, 3))
    high = (scales > CAMERA_HIGH) & (scales > STANDS_OUT * errors.scale())
    bias = np.linalg.norm(errors.standardised_bias, axis=-1)
    for i in np.flatnonzero(high | (bias > BIAS_HIGH)):
        said = [f"{scales[i]:.2f} times as far from the body as they should be"] if high[i] else []
        if bias[i] > BIAS_HIGH:
            right, down = errors.bias[i]
            said.append(f"off by ({right:+.3g}, {down:+.3g}) in the median, {bias[i]:.1f} times their noise")
        severity = ERROR if high[i] and scales[i] > CAMERA_ERROR else WARNING
        yield Verdict(severity, f"Points of camera {errors.cameras[i]} are {', and '.join(said)}:", _OF_CAMERA)


def _of_markers(errors: ImageErrors, markers: list[str]) -> Findings:
    scales = errors.scale((0, 1, 3))
    high = [i for i in np.argsort(-np.nan_to_num(scales)) if scales[i] > MARKER_HIGH]
    if 0 < len(high) <= len(markers) / 2:
        named = ", ".join(f"{markers[i]} {scales[i]:.1f}" for i in high[:MAX_NAMED])
        yield Verdict(WARNING, f"Markers are too far from the body, by factors of {named}:", _OF_MARKERS)


def _interval(errors: ImageErrors) -> tuple[float, float, float]:
    """Scale over all points, and its 95 % interval over batches of frames; no interval of a single frame."""
    square, expected = errors.sums((1, 2, 3))
    seen = (expected > 0) & (square > 0)
    if seen.sum() < 2:
        return float(errors.scale()), -np.inf, np.inf
    centre, _, reach = log_ratio(square[seen], expected[seen])
    scale, low, high = np.exp(np.array([centre, centre - reach, centre + reach]) / 2).tolist()
    return scale, low, high


def _without(errors: ImageErrors) -> str:
    """How many points the scale does not count."""
    share = 100 * errors.left_out
    return f"; without the {share:.0f} % of points whose posterior SD is larger than their noise" if share >= 1 else ""


def _largest(scales: Floats, names: list[str]) -> str:
    index = int(np.nanargmax(scales))
    return f"{names[index]} {scales[index]:.2f}"
