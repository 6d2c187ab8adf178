"""How far each camera's points are from where the posterior mean has them: noise and bias by camera, and over the frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array, mean_points
from poseppl.runs.contents import names_of, variable

MAD = 1.4826
"""Standard deviation of a normal error over the median of its absolute value."""


class ImageErrors(NamedTuple):
    """What a result tells of its cameras.

    Attributes:
        cameras: C names.
        residual: (T, C, K, 2) seen less expected, image units; NaN where a marker was not seen.
        noise: (T, C, K) standard deviations that the model was given; NaN where the result does not tell.
    """

    cameras: list[str]
    residual: Array
    noise: Array

    @property
    def distance(self) -> Array:
        """(T, C, K) image units."""
        return np.asarray(np.linalg.norm(self.residual, axis=-1))

    @property
    def bias(self) -> Array:
        """(C, 2) median over frames and markers; NaN for a camera that saw nothing."""
        return np.stack([_median(each.reshape(-1, 2)) for each in np.moveaxis(self.residual, 1, 0)])

    @property
    def spread(self) -> Array:
        """(C,) robust standard deviation of a coordinate about the bias."""
        beside = np.abs(self.residual - self.bias[:, None])
        return np.stack([MAD * _median(each.reshape(-1, 1))[0] for each in np.moveaxis(beside, 1, 0)])


def image_errors(tree: xr.DataTree) -> ImageErrors | None:
    """The errors in the images of a result; None where it holds no points of markers that were seen."""
    seen, expected = variable(tree, "observed_data", "points"), mean_points(tree)
    if seen is None or expected is None or seen.shape != expected.shape or not np.isfinite(seen).any():
        return None
    noise = variable(tree, "inputs", "noise")
    shape = seen.shape[:3]
    known = noise is not None and noise.ndim in (2, 3) and noise.shape[-2:] == shape[-2:] and len(noise) in (1, *shape[:2])
    given = np.broadcast_to(noise, shape) if known and noise is not None else np.full(shape, np.nan)
    return ImageErrors(names_of(tree, "camera", "observed_data"), np.asarray(seen - expected, np.float64), given)


def _median(values: Array) -> Array:
    known = values[np.isfinite(values).all(-1)]
    return np.median(known, axis=0) if len(known) else np.full(values.shape[-1], np.nan)
