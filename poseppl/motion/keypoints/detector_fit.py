"""The errors of a detector from a recording: each camera's keypoints against where the other cameras see them.

The fit maximises the prior times the product, over all keypoints, of the density of one camera's detection given the others' (a
pseudo-likelihood; Besag 1975, doi:10.2307/2987782). At least three cameras have to see a point: two alone agree along their
common plane, whatever their errors are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array
from scipy.special import expit

from poseppl.arrays import Floats
from poseppl.compilation import double_precision, jit
from poseppl.errors import Argument, InputError
from poseppl.motion.keypoints.detector_errors import DetectorErrors
from poseppl.motion.keypoints.held_out_cameras import DrawnPlaces, SeenPoints, draw_places, log_predictions

MIN_POINTS = 50
"""Minimum number of points that three cameras see, for a detector's errors."""
NUM_ROUNDS = 2
"""Places are drawn with errors of a first guess, and then with those that were found."""
_PRIORS = {"mean": (2.5, 2.0), "slope": (-0.2, 0.5), "clutter": (-5.0, 1.0), "clutter_slope": (-0.7, 0.5)}
"""Means and standard deviations of the normal priors of a log scale and of the others; ours."""
_APART = 0.5
"""Standard deviation of a keypoint's log scale around that of all."""


class _Params(NamedTuple):
    log_scale: Array
    slope: Array
    clutter: Array
    clutter_slope: Array


def fit_detector(seen: SeenPoints, markers: Sequence[str], source: str, seed: int = 0) -> DetectorErrors:
    """Find the errors of a detector.

    Args:
        seen: Detected points.
        markers: Names of the markers.
        source: Recording, for the record.
        seed: Seed of the draws.

    Raises:
        InputError: Fewer than 50 points are seen by three cameras.
    """
    if len(seen.marker) < MIN_POINTS:
        raise InputError(
            f"three cameras see {len(seen.marker)} points",
            field=Argument("files"),
            expected=f"{MIN_POINTS} or more",
        )
    middle = float(np.median(seen.logit[seen.seen]))
    seen = seen._replace(logit=seen.logit - middle)
    v, rng = np.zeros(4 + len(markers)), np.random.default_rng(seed)
    with double_precision():
        for _ in range(NUM_ROUNDS):
            scale = np.asarray(_scale_and_odds(_params(v), seen)[0])
            drawn = draw_places(seen, scale, rng)
            v = scipy.optimize.minimize(_loss, v, (drawn, seen, seen.seen), jac=True, method="L-BFGS-B", tol=1e-7).x
    found = _params(v)
    counts = np.bincount(seen.marker, seen.seen.sum(1), len(markers)).astype(int)
    return DetectorErrors(
        {name: float(found.log_scale[k]) for k, name in enumerate(markers) if counts[k]},
        slope=float(found.slope),
        clutter=float(found.clutter),
        clutter_slope=float(found.clutter_slope),
        confidence=float(expit(middle)),
        counts={name: int(counts[k]) for k, name in enumerate(markers) if counts[k]},
        source=source,
    )


def _params(v: Array | Floats) -> _Params:
    """Params of coordinates in which the prior is standard normal."""
    mean, slope, clutter, clutter_slope = (at + scale * v[i] for i, (at, scale) in enumerate(_PRIORS.values()))
    return _Params(mean + _APART * v[4:], slope, clutter, clutter_slope)


def _scale_and_odds(params: _Params, seen: SeenPoints) -> tuple[Array, Array]:
    scale = jnp.exp(params.log_scale[seen.marker][:, None] + params.slope * seen.logit) * seen.magnification
    return scale, params.clutter + params.clutter_slope * seen.logit


@jit
@jax.value_and_grad
def _loss(v: Array, drawn: DrawnPlaces, seen: SeenPoints, known: Array) -> Array:
    scale, odds = _scale_and_odds(_params(v), seen)
    return 0.5 * v @ v - jnp.sum(log_predictions(drawn, scale, odds, known, seen.sizes))
