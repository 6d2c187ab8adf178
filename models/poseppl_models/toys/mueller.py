r"""Mueller's potential surface in the plane, whose basins a sampler has to find: known by quadrature.

    V(x, y) = sum_k A_k exp(a_k (x - x_k)^2 + b_k (x - x_k)(y - y_k) + c_k (y - y_k)^2),    k = 1, ..., 4

(Mueller and Brown 1979, doi:10.1007/BF00547608), and the density exp(-V / temperature). Minima: V = -146.70 at (-0.558, 1.442),
-108.17 at (0.623, 0.028) and -80.77 at (-0.050, 0.467); saddles: V = -40.66 at (-0.822, 0.624) and -72.25 at (0.212, 0.293).

Du and Guan 2006 (section 2.2, Fig. 2b) sample it with DE-MC, and do not say at which temperature. At 15 the three basins have
90, 8 and 3 % of the probability, and the way from the second to the first goes over two barriers of 2.4 and 2.7 temperatures.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

MINIMA = ((-0.558224, 1.441726), (0.623499, 0.028038), (-0.050011, 0.466694))
"""The deepest points of the three basins, the deepest basin first."""

_HEIGHTS = (-200.0, -100.0, -170.0, 15.0)
_CURVES = ((-1.0, 0.0, -10.0), (-1.0, 0.0, -10.0), (-6.5, 11.0, -6.5), (0.7, 0.6, 0.7))
_CENTRES = ((1.0, 0.0), (0.0, 0.5), (-0.5, 1.5), (-1.0, 1.0))


def mueller_potential(position: Array) -> Array:
    """V at positions (..., 2), of shape (...)."""
    x, y = jnp.moveaxis(position[..., None, :] - jnp.asarray(_CENTRES, position.dtype), -1, 0)
    a, b, c = jnp.asarray(_CURVES, position.dtype).T
    return jnp.exp(a * x**2 + b * x * y + c * y**2) @ jnp.asarray(_HEIGHTS, position.dtype)


def mueller_log_density(position: Array, temperature: float = 15.0) -> Array:
    """Unnormalised log-density -V / temperature at positions (..., 2), of shape (...)."""
    return -mueller_potential(position) / temperature
