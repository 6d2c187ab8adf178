"""Silhouettes of elliptical truncated cones by casting one ray for each image point, in plain NumPy.

Coordinates are the cone's own, those across divided by the factors of its radii. The side is the surface x^2 + y^2 = (r_0 +
(r_1 - r_0) z / l)^2 with z between 0 and l, and the ends are discs: a ray meets the side where a quadratic vanishes, and an end
in one point.
"""

from __future__ import annotations

import numpy as np


def rays(rotation, focal, principal, points):
    """Directions (..., 3) in the world, of no particular length, from the eye through image points (..., 2)."""
    plane = (np.asarray(points, float) - principal) / focal
    return np.concatenate([plane, np.ones_like(plane[..., :1])], -1) @ np.asarray(rotation)


def cone_is_hit(eye, directions, axes, base, length, radii, scale=(1.0, 1.0)):
    """Whether rays (..., 3) from an eye outside meet a cone in front of it.

    ``axes`` (3, 3) has the cone's x, y and z as columns, ``base`` (3,) is where z = 0.
    """
    factors = np.array([*scale, 1.0])
    o = (np.asarray(eye, float) - base) @ axes / factors
    d = directions @ axes / factors
    slope = (radii[1] - radii[0]) / length
    along, rate = radii[0] + slope * o[2], slope * d[..., 2]  # the radius at the eye's height, and how it goes along the ray
    a = d[..., 0] ** 2 + d[..., 1] ** 2 - rate**2
    b = o[0] * d[..., 0] + o[1] * d[..., 1] - along * rate
    c = o[0] ** 2 + o[1] ** 2 - along**2
    hit = np.zeros(d.shape[:-1], bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b**2 - a * c)
        for t in ((-b - root) / a, (-b + root) / a):
            z = o[2] + t * d[..., 2]
            hit |= (t > 0) & (np.abs(z / length - 0.5) <= 0.5)
        for end, radius in zip((0.0, length), radii, strict=True):
            t = (end - o[2]) / d[..., 2]
            hit |= (t > 0) & ((o[0] + t * d[..., 0]) ** 2 + (o[1] + t * d[..., 1]) ** 2 <= radius**2)
    return hit
