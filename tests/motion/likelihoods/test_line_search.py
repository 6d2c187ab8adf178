"""Edges along normals: lines of known places in a map, their order, and what is too weak or too far."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.sminchisescu_triggs.contours import edges_along_normals

pytestmark = pytest.mark.full

LINES = {24.3: 0.5, 31.0: 0.9, 33.6: 0.3, 20.0: 0.1, 45.0: 1.0}
"""Columns and strengths of upright edges."""


def search(point, normal, **options):
    columns = np.arange(64.0)
    profile = np.max([strength * np.exp(-0.5 * (columns - column) ** 2) for column, strength in LINES.items()], 0)
    edges = jnp.asarray(np.tile(profile, (40, 1))[..., None], float)
    settings = {"window": 8, "number": 3, "threshold": 0.15, **options}
    places = (jnp.asarray(place, float)[:, None] for place in (point, normal))
    found = jax.jit(lambda u, m: edges_along_normals(edges, jnp.ones(1), u, m, **settings))(*places)
    return np.asarray(found.offset)[:, 0], np.asarray(found.strength)[:, 0]


def test_all_maxima_of_the_window_are_found():
    """The strongest first, to 0.15 px (a parabola through a Gaussian); the weak one and the far one are none."""
    offset, strength = search((28.0, 20.0), (1.0, 0.0))
    np.testing.assert_allclose(offset, [3.0, -3.7, 5.6], atol=0.15)
    np.testing.assert_allclose(strength, [0.9, 0.5, 0.3], atol=0.05)
    assert np.all(search((28.0, 20.0), (1.0, 0.0), threshold=0.05, number=4)[1] > 0.05)


def test_offsets_go_along_the_normal():
    """Turned round, offsets change their sign; at 45 degrees they are longer by root 2; with no edge at all there is none."""
    offset, _ = search((28.0, 20.0), (-1.0, 0.0))
    np.testing.assert_allclose(offset, [-3.0, 3.7, -5.6], atol=0.15)
    slanted, strength = search((28.0, 20.0), (np.sqrt(0.5), np.sqrt(0.5)), number=2)
    np.testing.assert_allclose(slanted, [3.0 * np.sqrt(2), -3.7 * np.sqrt(2)], atol=0.2)
    assert np.all(strength > 0.4)
    assert np.all(search((28.0, 20.0), (0.0, 1.0))[1] == 0)
    assert search((28.0, 20.0), (1.0, 0.0), number=1)[0].shape == (1,)
