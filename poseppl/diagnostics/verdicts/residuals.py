"""Residuals of image points, in units of what they should be.

Where model and posterior are right, the posterior expectation of a point's squared distance from its projection averages to the
square of its noise s (law of total variance), so that for the posterior's mean m and variance v of the projection

    E[(y - m)^2] = s^2 - v.

The scale of a group of points is sqrt(sum (y - m)^2 / s^2 / sum (1 - v / s^2)): 1 when right, of filters and of smoothers, of
linear models and others. Where v comes near s^2 the identity expects next to nothing, and a spread that is a little off, such
as that of a Gaussian which the projection bends, says more of itself than of the noise: such points are left out, and counted.
They are chosen by their spread, which in a linear Gaussian model no data change, so that the identity holds for the others.

If the noise alone is wrong, intervals of a run of scale 1.2 are as much too narrow, and hold 83 % where they promise 90 %; at
1.1 they hold 87 %.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import log_ratio
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Verdict, array_of, of_walk
from poseppl.runs.contents import names_of

SCALE_HIGH, SCALE_ERROR = 1.1, 1.2
"""Scales of all points above which their verdict is a warning, an error."""
SCALE_LOW = 0.7
CAMERA_HIGH, CAMERA_ERROR = 1.15, 1.3
"""Scales of one camera that stands out, above which its verdict is a warning, an error."""
STANDS_OUT = 1.05
"""Factor by which the scale of a camera that stands out exceeds that of all points."""
MARKER_HIGH = 2.0
MAX_NAMED = 4
BIAS_HIGH = 0.7
"""Mean residual of a camera, in units of its noise, from which on it is told."""
LEAST_SHARE = 0.25
"""Share of the noise's variance below which a residual is left out: a tenth more spread would be a third less of it."""


class Residuals(NamedTuple):
    """Residuals of points (frame, camera, marker, xy), NaN where nothing was seen.

    Attributes:
        standardised: (y - m) / s.
        expected: What their squares should be on average, 1 - v / s^2; NaN where that is below `LEAST_SHARE`, too.
        offset: y - m, in units of the image.
    """

    standardised: Floats
    expected: Floats
    offset: Floats

    def scale(self, axes: tuple[int, ...] | None = None) -> Any:
        """Scale over the axes; over all if None. NaN where all are left out."""
        square, expected = self.sums(axes)
        return np.sqrt(square / np.where(expected > 0, expected, np.nan))

    def sums(self, axes: tuple[int, ...] | None = None) -> tuple[Any, Any]:
        """Squares, and what they should be, summed over the axes."""
        squares = np.where(np.isfinite(self.expected), self.standardised**2, 0.0)
        return squares.sum(axis=axes), np.nansum(self.expected, axis=axes)

    @property
    def left_out(self) -> float:
        """Share of the residuals of which the identity expects next to nothing."""
        seen = np.isfinite(self.standardised)
        return float(1 - np.isfinite(self.expected)[seen].mean()) if seen.any() else 0.0


def residuals_of(tree: xr.DataTree) -> Residuals | None:
    """Residuals of a result; None where it has no points, or does not tell their noise and projections."""
    points, noise = (array_of(tree, *where) for where in (("observed_data", "points"), ("inputs", "noise")))
    mean, deviation = _projection(tree)
    if points is None or noise is None or mean is None or points.shape != mean.shape or not np.isfinite(points).any():
        return None
    if noise.shape != points.shape[-1 - noise.ndim : -1]:
        return None
    seen = np.isfinite(points)
    spread = np.broadcast_to(np.where(noise > 0, noise, np.nan)[..., None], points.shape)
    offset = np.where(seen, points - mean, np.nan)
    expected = 1 - np.square(deviation / spread)
    return Residuals(offset / spread, np.where(seen & (expected >= LEAST_SHARE), expected, np.nan), offset)


def point_residuals(tree: xr.DataTree) -> list[Verdict]:
    """Points farther from the body than noise and posterior allow, or nearer; by camera and marker."""
    residuals, cameras, markers = residuals_of(tree), names_of(tree, "camera"), names_of(tree, "marker")
    if residuals is None or not (cameras and markers):
        return []
    return [*_overall(tree, residuals, cameras, markers), *_of_cameras(residuals, cameras), *_of_markers(residuals, markers)]


def _overall(tree: xr.DataTree, residuals: Residuals, cameras: list[str], markers: list[str]) -> list[Verdict]:
    scale, low, high = _interval(residuals)
    if scale > SCALE_HIGH and low > 1:
        worst = [_largest(residuals.scale((0, 1, 3)), markers)]
        if len(cameras) > 1:
            worst.insert(0, _largest(residuals.scale((0, 2, 3)), cameras))
        text = f"Image points are {scale:.2f} times as far from the body as noise and posterior allow"
        text += f" (worst {', '.join(worst)}{_without(residuals)})"
        follows = of_walk(tree, "raise --sigma-angle and --sigma-position")
        advice = f"raise --noise by that factor, mend calibration or lengths, or {follows}"
        return [Verdict(ERROR if scale > SCALE_ERROR else WARNING, f"{text}: {advice}.")]
    if scale < SCALE_LOW and high < 1:
        text = f"Image points are {scale:.2f} times as far from the body as noise and posterior allow"
        return [Verdict(WARNING, f"{text}: intervals are too wide; lower --noise by that factor.")]
    return []


def _of_cameras(residuals: Residuals, cameras: list[str]) -> list[Verdict]:
    """Cameras that stand out among others, by scale or by mean."""
    if len(cameras) < 2:
        return []
    scales, found = residuals.scale((0, 2, 3)), []
    high = (scales > CAMERA_HIGH) & (scales > STANDS_OUT * residuals.scale())
    bias = np.linalg.norm(_mean(residuals.standardised, (0, 2)), axis=-1)
    shift = _mean(residuals.offset, (0, 2))
    for i in np.flatnonzero(high | (bias > BIAS_HIGH)):
        said = [f"{scales[i]:.2f} times as far from the body as they should be"] if high[i] else []
        if bias[i] > BIAS_HIGH:
            said.append(f"off by ({_number(shift[i, 0])}, {_number(shift[i, 1])}) on average, {bias[i]:.1f} times their noise")
        severity = ERROR if high[i] and scales[i] > CAMERA_ERROR else WARNING
        advice = "check its calibration (--camera), its synchrony and who is in its points"
        found.append(Verdict(severity, f"Points of camera {cameras[i]} are {', and '.join(said)}: {advice}."))
    return found


def _of_markers(residuals: Residuals, markers: list[str]) -> list[Verdict]:
    scales = residuals.scale((0, 1, 3))
    high = [i for i in np.argsort(-np.nan_to_num(scales)) if scales[i] > MARKER_HIGH]
    if not high or len(high) > len(markers) / 2:
        return []
    named = ", ".join(f"{markers[i]} {scales[i]:.1f}" for i in high[:MAX_NAMED])
    advice = "the lengths (--stature, --model) or the detector's idea of them differ"
    return [Verdict(WARNING, f"Markers lie too far from the body, by factors of {named}: {advice}.")]


def _interval(residuals: Residuals) -> tuple[float, float, float]:
    """Scale over all points, and its 95 % interval over batches of frames; no interval of a single frame."""
    square, expected = residuals.sums((1, 2, 3))
    seen = (expected > 0) & (square > 0)
    if seen.sum() < 2:
        return float(residuals.scale()), -np.inf, np.inf
    ratio = log_ratio(square[seen], expected[seen])
    centre, reach = ratio.estimate / 2, ratio.half_width / 2
    return float(np.exp(centre)), float(np.exp(centre - reach)), float(np.exp(centre + reach))


def _without(residuals: Residuals) -> str:
    """How many points the scale does not count."""
    share = 100 * residuals.left_out
    return f"; {share:.0f} % of them left out, whose spread hides their noise" if share >= 1 else ""


def _mean(values: Floats, axes: tuple[int, ...]) -> Floats:
    count = np.isfinite(values).sum(axis=axes)
    return np.asarray(np.nansum(values, axis=axes) / np.maximum(count, 1))


def _largest(scales: Floats, names: list[str]) -> str:
    index = int(np.nanargmax(scales))
    return f"{names[index]} {scales[index]:.2f}"


def _number(value: float) -> str:
    return f"{value:+.3g}"


def _projection(tree: xr.DataTree) -> tuple[Floats | None, Any]:
    """Posterior mean and standard deviation of the projections, over all draws where the summary has them."""
    mean, deviation = (array_of(tree, "summary", f"points_{part}") for part in ("mean", "sd"))
    if mean is not None and deviation is not None:
        return mean, deviation
    draws = array_of(tree, "posterior", "points")
    if draws is None or draws.ndim != 6:
        return None, None
    return draws.mean(axis=(0, 1)), draws.std(axis=(0, 1))
