"""How far each camera's points are from where the posterior mean has them: noise and bias by camera, and over the frames.

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
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array
from poseppl.motion.poses import mean_points
from poseppl.runs.contents import draws_of, names_of, variable

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
