"""Silhouettes of tapered and bent superquadrics by marching along rays, in plain NumPy.

A point is inside if, unbent and then untapered, it satisfies Barr's inequality

    (|x / a|^(2/e_2) + |y / b|^(2/e_2))^(e_2/e_1) + |z / c|^(2/e_1) <= 1.

The arc's centre lies at the distance 1 / k from the part's centre, in the direction of bending: the angle about it is k z.
"""

from __future__ import annotations

import numpy as np


def is_inside(points, part):
    """Whether points (..., 3) of the part's frame are inside a superquadric of Sminchisescu and Triggs."""
    x, y, z = unbent(np.moveaxis(np.asarray(points, float), -1, 0), part)
    a, b, c = part.half_axes
    (along, across), (narrow_x, narrow_y) = part.exponents, part.taper
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = np.abs(x / (1 + narrow_x * z / c) / a), np.abs(y / (1 + narrow_y * z / c) / b)
        level = (x ** (2 / across) + y ** (2 / across)) ** (across / along) + np.abs(z / c) ** (2 / along)
    return (np.abs(z) <= c) & (level <= 1)


def unbent(points, part):
    x, y, z = points
    curvature = part.bend / (2 * part.half_axes[2])
    if curvature == 0:
        return x, y, z
    direction = np.array([np.cos(part.bend_towards), np.sin(part.bend_towards)]) * np.sign(curvature)
    radius = 1 / abs(curvature)
    r = direction[0] * x + direction[1] * y
    straight = radius - np.hypot(z, radius - r)
    return x + direction[0] * (straight - r), y + direction[1] * (straight - r), np.arctan2(z, radius - r) * radius


def part_is_hit(eye, directions, axes, centre, part, steps=160):
    """Whether rays (K, 3) from an eye outside meet the part; misses chords that are shorter than a step.

    ``axes`` (3, 3) has the part's x, y and z as columns, ``centre`` (3,) is its centre.
    """
    a, b, c = part.half_axes
    reach = np.hypot(np.hypot(a, b) * (1 + max(map(abs, part.taper))), c)  # bending keeps sections rigid and shortens the axis
    origin = (np.asarray(eye, float) - centre) @ axes
    way = directions @ axes / np.linalg.norm(directions, axis=-1, keepdims=True)
    nearest, closest = -way @ origin, np.linalg.norm(origin - (way @ origin)[:, None] * way, axis=-1)
    near = np.flatnonzero(closest < 1.5 * reach)
    hit = np.zeros(len(way), bool)
    for step in np.linspace(-1.5 * reach, 1.5 * reach, steps):
        left = near[~hit[near]]
        hit[left] = is_inside(origin + (nearest[left] + step)[:, None] * way[left], part)
    return hit
