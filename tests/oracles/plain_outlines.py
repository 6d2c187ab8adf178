"""Outlines, silhouettes and samples of cones in images as plain NumPy loops, one camera, part and row at a time."""

from __future__ import annotations

import numpy as np


def camera_of(cameras, index):
    leaves = (cameras.rotation, cameras.centre, cameras.focal, cameras.principal)
    return [np.asarray(leaf, float)[index] for leaf in leaves]


def image_of(camera, point):
    rotation, centre, focal, principal = camera
    x, y, z = rotation @ (np.asarray(point, float) - centre)
    return np.array([focal[0] * x / z + principal[0], focal[1] * y / z + principal[1]])


def cones_of(flesh, parts):
    """Base, tip, x, y, radii and scales of each part."""
    axes, base, tip = (np.asarray(leaf, float) for leaf in parts)
    radii, scales = np.asarray(flesh.radii, float), np.asarray(flesh.scales, float)
    return [(base[p], tip[p], axes[p][:, 0], axes[p][:, 1], radii[p], scales[p]) for p in range(len(base))]


def outline(camera, cone):
    """Corners (4, 2): base, tip, tip, base."""
    base, tip, x, y, radii, scales = cone
    away = (base + tip) / 2 - camera[1]
    along = np.array([away @ x / scales[0], away @ y / scales[1]])
    along /= np.linalg.norm(along)
    u = -along[1] * scales[0] * x + along[0] * scales[1] * y
    points = (base - radii[0] * u, tip - radii[1] * u, tip + radii[1] * u, base + radii[0] * u)
    return np.array([image_of(camera, point) for point in points])


def limbs(camera, cone):
    """Corners (4, 2) between the lines along which rays touch the cone: where the normal is at right angles to the ray."""
    base, tip, x, y, radii, scales = cone
    length = np.linalg.norm(tip - base)
    eye = camera[1] - base
    along, ex, ey = eye @ (tip - base) / length, eye @ x / scales[0], eye @ y / scales[1]
    half = np.arccos((radii[0] + (radii[1] - radii[0]) / length * along) / np.hypot(ex, ey))
    first, second = (
        np.cos(angle) * scales[0] * x + np.sin(angle) * scales[1] * y for angle in np.arctan2(ey, ex) + np.array([-half, half])
    )
    points = (base + radii[0] * first, tip + radii[1] * first, tip + radii[1] * second, base + radii[0] * second)
    return np.array([image_of(camera, point) for point in points])


def ellipse(camera, cone, ring):
    """Centre and half-axes' matrix of a ring's image, from its dual conic; a quarter of a pixel is added all round."""
    rotation, eye, focal, principal = camera
    lens = np.array([[focal[0], 0, principal[0]], [0, focal[1], principal[1]], [0, 0, 1]])
    base, tip, x, y, radii, scales = cone
    centre = lens @ rotation @ ((base, tip)[ring] - eye)
    arms = [lens @ rotation @ (radii[ring] * scale * axis) for axis, scale in ((x, scales[0]), (y, scales[1]))]
    conic = np.outer(centre, centre) - sum(np.outer(arm, arm) for arm in arms)
    middle = conic[:2, 2] / conic[2, 2]
    return middle, np.outer(middle, middle) - conic[:2, :2] / conic[2, 2] + 0.25**2 * np.eye(2)


def silhouette(camera, cones, rows, columns):
    """Pixels at given rows and columns that parts cover: on each row between the outermost points of each part."""
    covered = np.zeros((len(rows), len(columns)), bool)
    for cone in cones:
        corners = limbs(camera, cone)
        rings = [ellipse(camera, cone, ring) for ring in range(2)]
        for index, y in enumerate(rows):
            found = []
            for start, end in zip(corners, np.roll(corners, -1, 0), strict=True):
                if (start[1] <= y) != (end[1] <= y):
                    found.append(start[0] + (y - start[1]) / (end[1] - start[1]) * (end[0] - start[0]))
            for centre, matrix in rings:
                (xx, xy), (_, yy) = np.linalg.inv(matrix)
                dy = y - centre[1]
                square = (xy * dy) ** 2 - xx * (yy * dy**2 - 1)
                if square > 0:
                    found += [centre[0] + (-xy * dy + sign * np.sqrt(square)) / xx for sign in (-1, 1)]
            if found:
                covered[index] |= (columns >= min(found)) & (columns <= max(found))
    return covered


def hull_silhouette(camera, cones, height, width):
    """Pixels (H, W) inside of the convex hull of the images of both rings, which is what a cone covers."""
    from scipy.spatial import ConvexHull

    angles = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    y, x = np.mgrid[:height, :width]
    covered = np.zeros((height, width), bool)
    for base, tip, ax, ay, radii, scales in cones:
        ring = np.cos(angles)[:, None] * scales[0] * ax + np.sin(angles)[:, None] * scales[1] * ay
        points = np.concatenate([base + radii[0] * ring, tip + radii[1] * ring])
        hull = ConvexHull([image_of(camera, point) for point in points])
        covered |= np.all([a * x + b * y + c <= 0 for a, b, c in hull.equations], 0)
    return covered


def side_samples(corners, count):
    """Points (2 * count, 2) at the middles of pieces of both sides, and the length that each stands for."""
    points, weights = [], []
    for start, end in ((corners[0], corners[1]), (corners[2], corners[3])):
        for k in range(count):
            points.append(start + (k + 0.5) / count * (end - start))
            weights.append(np.linalg.norm(end - start))
    return np.array(points), np.array(weights)


def inside_samples(corners, rows, columns):
    """Points (rows * columns, 2) at the centres of cells, and the area of the outline for each."""
    points = []
    for i in range(rows):
        first, other = (corners[a] + (i + 0.5) / rows * (corners[b] - corners[a]) for a, b in ((0, 1), (3, 2)))
        points += [first + (j + 0.5) / columns * (other - first) for j in range(columns)]
    x, y = corners.T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return np.array(points), np.full(len(points), area)


def nearest_mean(values, known, points, weights, empty):
    """Weighted mean of an image's values (H, W) at the nearest pixels that are inside and known."""
    total = number = 0.0
    for (x, y), weight in zip(points, weights, strict=True):
        row, column = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
        if 0 <= row < values.shape[0] and 0 <= column < values.shape[1] and known[row, column]:
            total, number = total + weight * values[row, column], number + weight
    return total / number if number else empty


def distance_to_sides(point, outlines):
    best = np.inf
    for corners in outlines:
        for start, end in ((corners[0], corners[1]), (corners[2], corners[3])):
            t = np.clip((point - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
            best = min(best, np.linalg.norm(point - start - t * (end - start)))
    return best
