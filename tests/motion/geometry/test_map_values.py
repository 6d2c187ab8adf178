"""Values of maps between their pixels, at the map's own scale and at half of it."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.likelihoods.distance_maps import at_points


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_linear_map_is_read_exactly(scale):
    """A pixel of a map of half the size covers two of the image: its centre is at 0.5, 2.5, ..."""
    rows, columns = np.mgrid[:8, :10]
    places = [(axis + 0.5) / scale - 0.5 for axis in (columns, rows)]
    maps = jnp.asarray(3.0 * places[0] - 2.0 * places[1], jnp.float32)[None, :, :, None]
    x, y = (jnp.asarray(values, jnp.float32) for values in ([[2.0, 3.25, 7.5]], [[1.5, 4.0, 5.75]]))
    found = at_points(maps, jnp.full((1, 1), scale), x, y)
    np.testing.assert_allclose(found, 3.0 * x - 2.0 * y, atol=1e-4)
