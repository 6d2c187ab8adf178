r"""Predictions of a camera's detections from those of the other cameras.

The position x of a point has a wide prior about the middle of all positions. Let p_c(y | x) be the density of camera c's
detection y of x (:mod:`poseppl.motion.keypoints.detector_errors`), clutter included. Then

    p(y_c | others) = int prod_d p_d(y_d | x) p(x) dx / int prod_(d != c) p_d(y_d | x) p(x) dx

Both integrals are importance sampling's, over the same draws of x: from Student-t densities around where the rays of each two
of the cameras meet, and of all of them, and from p(x). Whichever camera has clutter, there are draws about where the others see
the point; and that a place is not known exactly is part of the prediction.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.nn import log_sigmoid
from jax.scipy.special import logsumexp as jax_logsumexp
from scipy.special import expit, gammaln, logsumexp, stdtr

from poseppl.arrays import Booleans, Floats, Integers
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.keypoints.detector_errors import FREEDOM, logits, magnifications

NUM_DRAWS = 96
"""S, draws of each place."""
_MAX = 1500
"""Points that are used at most, evenly spaced."""
_WIDER = 1.5
"""Scale of the densities that places are drawn from, in that of their errors."""
_NARROWEST = 100.0
"""Scale of where places are, mm, at least."""


class SeenPoints(NamedTuple):
    """N points in space, each seen by three of C cameras or more.

    Attributes:
        cameras: C cameras.
        sizes: (C, 2) width and height of the pictures, px.
        marker: (N,) which marker each point is.
        points: (N, C, 2) px; NaN where a camera does not see it.
        logit: (N, C) of the confidence.
        magnification: (N, C) px that a mm has there.
    """

    cameras: Cameras
    sizes: Floats
    marker: Integers
    points: Floats
    logit: Floats
    magnification: Floats

    @property
    def seen(self) -> Booleans:
        """(N, C) whether a camera sees it."""
        return np.asarray(np.isfinite(self.points).all(-1))

    def part(self, rows: slice) -> SeenPoints:
        """Some of the points."""
        cut = {name: getattr(self, name)[rows] for name in ("marker", "points", "logit", "magnification")}
        return self._replace(**cut)


class DrawnPlaces(NamedTuple):
    """S draws of each of N places.

    Attributes:
        offset: (N, S, C, 2) px, from the projection of a draw to what was seen; 0 where a camera does not see the point.
        log_weight: (N, S) log of the density of the place over that of the draw.
    """

    offset: Floats
    log_weight: Floats


def seen_points(cameras: Cameras, points: Floats, confidence: Floats, sizes: Floats) -> SeenPoints:
    """Gather what three cameras or more see.

    Args:
        cameras: C cameras.
        points: (T, C, K, 2) px; NaN where a point was not seen.
        confidence: (T, C, K).
        sizes: (C, 2) width and height of the pictures, px.
    """
    size = np.moveaxis(magnifications(cameras, triangulate(cameras, points, confidence)), 1, 2)
    points, confidence = np.moveaxis(points, 1, 2), np.moveaxis(confidence, 1, 2)  # (T, K, C, ...)
    rows = np.argwhere(np.isfinite(points).all(-1).sum(-1) >= 3)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(_MAX, len(rows))).astype(int))]
    at = tuple(rows.T)
    return SeenPoints(cameras, sizes, rows[:, 1], points[at], logits(confidence[at]), size[at])


def draw_places(seen: SeenPoints, scale: Floats, rng: np.random.Generator) -> DrawnPlaces:
    """Draw places, and weigh them.

    Args:
        seen: Detections of them.
        scale: (N, C) about those of the errors, px.
        rng: Random generator of the draws.
    """
    num, count = seen.seen.shape
    subsets = [*itertools.combinations(range(count), 2), tuple(range(count))]
    means, covariances = zip(*(_meeting(seen, scale, np.isin(np.arange(count), subset)) for subset in subsets), strict=True)
    middle = np.median(means[-1], 0)
    spread = np.maximum(1.4826 * np.median(np.abs(means[-1] - middle), 0), _NARROWEST)
    mean, covariance = np.stack([*means, np.broadcast_to(middle, (num, 3))], 1), np.stack(covariances, 1)
    covariance = np.concatenate([covariance, np.broadcast_to(np.diag(spread**2), (num, 1, 3, 3))], 1)
    known = np.isfinite(mean).all(-1)
    root = np.linalg.cholesky(np.where(known[..., None, None], covariance, np.eye(3)))
    chosen = np.argmax(rng.gumbel(size=(num, NUM_DRAWS, mean.shape[1])) + np.where(known, 0.0, -np.inf)[:, None], -1)
    row = np.arange(num)[:, None]
    normal = rng.standard_normal((num, NUM_DRAWS, 3)) / np.sqrt(rng.chisquare(FREEDOM, (num, NUM_DRAWS, 1)) / FREEDOM)
    place = mean[row, chosen] + np.einsum("nsij,nsj->nsi", root[row, chosen], normal)
    each = _log_student(place, np.nan_to_num(mean), np.asarray(np.linalg.inv(root), np.float64))
    drawn = logsumexp(np.where(known[:, None], each, -np.inf), -1) - np.log(known.sum(-1))[:, None]
    projected = np.moveaxis(np.asarray(project(seen.cameras, jnp.asarray(place, float)), np.float64), 0, 2)
    offset = np.where(seen.seen[:, None, :, None], seen.points[:, None] - projected, 0.0)
    return DrawnPlaces(offset, each[..., -1] - drawn)


def _meeting(seen: SeenPoints, scale: Floats, subset: Booleans) -> tuple[Floats, Floats]:
    """Triangulate positions (N, 3) from some cameras, with scale matrices (N, 3, 3); NaN if fewer than two see a point."""
    points = np.where(subset[:, None], seen.points, np.nan)
    weight = np.where(np.isfinite(points).all(-1), scale**-2.0, 0.0)
    place = triangulate(seen.cameras, points[:, :, None], (weight * seen.magnification**2)[..., None])[:, 0]
    slope = jax.vmap(jax.jacfwd(lambda x: project(seen.cameras, x)))(jnp.asarray(np.nan_to_num(place), float))
    information = np.einsum("nc,ncij,ncik->njk", weight, np.asarray(slope, np.float64), np.asarray(slope, np.float64))
    return place, _WIDER**2 * np.linalg.inv(information + 1e-6 * np.eye(3))  # of a metre at most, where rays are parallel


def _log_student(place: Floats, mean: Floats, inverse: Floats) -> Floats:
    """Log-densities (N, S, P) of places (N, S, 3) in P Student-t's, of Cholesky factors of this inverse."""
    unit = np.einsum("npij,nsj->nspi", inverse, place) - np.einsum("npij,npj->npi", inverse, mean)[:, None]
    volume = np.log(np.diagonal(inverse, axis1=-2, axis2=-1)).sum(-1)[:, None]
    constant = gammaln((FREEDOM + 3) / 2) - gammaln(FREEDOM / 2) - 1.5 * np.log(FREEDOM * np.pi)
    return np.asarray(constant + volume - (FREEDOM + 3) / 2 * np.log1p((unit**2).sum(-1) / FREEDOM))


def log_densities(drawn: DrawnPlaces, scale: Array, odds: Array, seen: Booleans | Array, sizes: Floats) -> Array:
    """Log-densities (N, S, C) of what cameras saw of the draws; 0 where one does not see the point.

    Args:
        drawn: The draws.
        scale: (N, C) of the errors, px.
        odds: (N, C) log-odds of clutter.
        seen: (N, C).
        sizes: (C, 2) px.
    """
    squared = jnp.sum(jnp.square(drawn.offset), -1) / scale[:, None] ** 2
    inside = -jnp.log(2 * jnp.pi * scale[:, None] ** 2) - (FREEDOM + 2) / 2 * jnp.log1p(squared / FREEDOM)
    outside = log_sigmoid(odds) - jnp.log(jnp.prod(sizes, -1))
    return jnp.where(seen[:, None], jnp.logaddexp(log_sigmoid(-odds)[:, None] + inside, outside[:, None]), 0.0)


def log_predictions(drawn: DrawnPlaces, scale: Array, odds: Array, seen: Booleans | Array, sizes: Floats) -> Array:
    """Log-densities (N, C) of what each camera saw given what the others saw; arguments as above."""
    each = log_densities(drawn, scale, odds, seen, sizes)
    total = (each.sum(-1) + drawn.log_weight)[..., None]
    return jnp.where(seen, jax_logsumexp(total, 1) - jax_logsumexp(total - each, 1), 0.0)


def probabilities(drawn: DrawnPlaces, scale: Floats, odds: Floats, seen: SeenPoints) -> Floats:
    """Probability below each detected coordinate (N, C, 2), given the other cameras; NaN if not detected.

    They are uniform where the errors are right; arguments as above.
    """
    each = np.asarray(log_densities(drawn, jnp.asarray(scale), jnp.asarray(odds), seen.seen, seen.sizes), np.float64)
    others = (each.sum(-1) + drawn.log_weight)[..., None] - each
    weight = np.exp(others - logsumexp(others, 1, keepdims=True))
    inside = np.einsum("nsc,nsci->nci", weight, stdtr(FREEDOM, drawn.offset / scale[:, None, :, None]))
    clutter = expit(odds)[..., None]
    return np.asarray((1 - clutter) * inside + clutter * np.clip(seen.points / seen.sizes, 0.0, 1.0))
