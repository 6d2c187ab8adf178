"""Implicit surfaces of superquadrics: how far a point is outside of a part, or inside, batch last.

A point of the part's frame is unbent and untapered; of what is left, (x, y, z), the gauge

    G = ((|x / a|^(2/e_2) + |y / b|^(2/e_2))^(e_2/e_1) + |z / c|^(2/e_1))^(e_1/2)

is 1 on the surface, less inside, and grows in proportion to the distance from the centre (Barr's inside-outside function is
G^(2/e_1)). The implicit surface is f = 0 for

    f = (G - 1) min(a, b, c),

in mm, negative inside: of a convex part without tapering and bending never more than the distance from the surface, and that
distance across its thinnest direction.

>>> import jax
>>> from poseppl.motion.geometry import Joint, Marker, kinematic_tree
>>> from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, superquadrics_of
>>> tree = kinematic_tree([Joint("hip", None, (0, 0, 0), "X")], [Marker("knee", "hip", (0, 0, -400))])
>>> egg = superquadrics_of(tree, [Superquadric("egg", "hip", (50.0, 50.0, 100.0))])
>>> last = jax.tree.map(lambda leaf: leaf[..., None], egg)
>>> places = jnp.array([[[60.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 100.0]]])[..., None]
>>> [round(float(f), 1) for f in surface_distances(last, places)[0, :, 0]]
[10.0, -50.0, 0.0]
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics

_MIN = 1e-6
_NEAREST = 0.05
"""Points beyond the centre of a part's arc are taken to lie at so much of its radius before it."""
_STEEP = 8.0
"""Exponent of a potential above which it grows linearly."""
_SMALL = 1e-3
"""Turns below which atan(q) / q is its series."""


def surface_distances(flesh: Superquadrics, points: Array) -> Array:
    """The implicit surface f (P, K, N), mm, at points (P, K, 3, N) of the parts' own frames."""
    x, y, z = _straightened(flesh, *(points[:, :, i] for i in range(3)))
    a, b, c = (flesh.half_axes[:, i, None] for i in range(3))
    along, across = (2 / flesh.exponents[:, i, None] for i in range(2))
    gauge = _norm(_norm(jnp.abs(x) / a, jnp.abs(y) / b, across), jnp.abs(z) / c, along)
    return (gauge - 1) * jnp.min(flesh.half_axes, 1)[:, None]


def penetration(flesh: Superquadrics, points: Array, *, softness: Array | float, decay: float) -> Array:
    """Repulsive potentials (P, N) of parts (Sminchisescu and Triggs 2001, section 3.2).

    Each is the mean over points of exp(-f |f|^(p - 1)), f being the implicit surface in units of the softness: 1 at the
    surface, as good as 0 some softnesses outside, and growing fast inside. Above e^8 it goes on along its tangent, in
    -f |f|^(p - 1), which float32 can follow.

    Args:
        flesh: P parts that repel, leaves (P, ..., N or 1).
        points: The points that each repels (P, K, 3, N), mm, in its own frame.
        softness: Unit of f, mm.
        decay: p.
    """
    f = surface_distances(flesh, points) / softness
    exponent = -f * jnp.maximum(jnp.abs(f), _MIN) ** (decay - 1)
    return jnp.mean(jnp.exp(jnp.minimum(exponent, _STEEP)) * (1 + jnp.maximum(exponent - _STEEP, 0.0)), 1)


def _straightened(flesh: Superquadrics, x: Array, y: Array, z: Array) -> tuple[Array, ...]:
    """Coordinates (P, K, N) before the part was tapered and bent."""
    towards = flesh.bends[:, 1, None]
    cosine, sine = jnp.cos(towards), jnp.sin(towards)
    c = flesh.half_axes[:, 2, None]
    curvature = flesh.bends[:, 0, None] / (2 * c)
    r = cosine * x + sine * y
    left = jnp.maximum(1 - curvature * r, _NEAREST)
    turn = curvature * z / left
    root = jnp.sqrt(left**2 + (curvature * z) ** 2)
    straight = (2 * r - curvature * (r * r + z * z)) / (1 + root)  # 1 / k - its distance from the arc's centre
    height = z / left * _atan_ratio(turn)
    wide = jnp.clip(height / c, -1, 1)
    x, y = x + cosine * (straight - r), y + sine * (straight - r)
    return x / (1 + flesh.tapers[:, 0, None] * wide), y / (1 + flesh.tapers[:, 1, None] * wide), height


def _atan_ratio(q: Array) -> Array:
    """atan(q) / q, for 0 too."""
    small = jnp.abs(q) < _SMALL
    safe = jnp.where(small, 1.0, q)
    return jnp.where(small, 1 - q * q / 3, jnp.arctan(safe) / safe)


def _norm(u: Array, v: Array, power: Array) -> Array:
    """(u^p + v^p)^(1/p) of numbers that are not negative, without overflow."""
    most = jnp.maximum(jnp.maximum(u, v), _MIN)
    shares = sum(jnp.exp(power * jnp.log(jnp.maximum(each / most, _MIN))) for each in (u, v))
    return most * jnp.exp(jnp.log(shares) / power)
