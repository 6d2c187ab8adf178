r"""Localisation: tapers that keep an ensemble's sampled covariances only between what is near.

A covariance sampled from N states has an error of about 1 / sqrt(N) in each correlation, also where there is none, and at
most N - 1 directions. Times a taper, a correlation function \rho of the distance, entry by entry (Houtekamer and
Mitchell 2001, doi:10.1175/1520-0493(2001)129<0123:ASEKFF>2.0.CO;2),

    \rho_xy o Cov[x, y],    \rho_yy o Cov[y, y],

it is zero between what is far apart, and by Schur's theorem positive semi-definite where \rho is. The built-in \rho is that of
Gaspari and Cohn 1999 (doi:10.1002/qj.49712555417, Eq. 4.10): with z = distance / c it is nearly a Gaussian of standard
deviation c sqrt(3 / 10), and 0 from z = 2 on.

>>> [round(float(value), 3) for value in gaspari_cohn(jnp.array([0.0, 0.5, 1.0, 2.0, 9.0]))]
[1.0, 0.685, 0.208, 0.0, 0.0]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.program import CompiledModel


class Localisation(NamedTuple):
    """Tapers of sampled covariances, each in [0, 1].

    Attributes:
        states: Taper between the d coordinates of the flat state and the k data, (d, k).
        data: Taper between the data, (k, k), symmetric, with ones on the diagonal.
    """

    states: Any
    data: Any


def gaspari_cohn(z: Array) -> Array:
    """The correlation function of Gaspari and Cohn at z = distance / c, of any shape; 0 from z = 2 on."""
    near, far = jnp.minimum(z, 1.0), jnp.clip(z, 1.0, 2.0)
    inner = 1.0 + near**2 * (-5 / 3 + near * (5 / 8 + near * (1 / 2 - near / 4)))
    outer = (2.0 - far) ** 4 * (far**2 + 2.0 * far - 0.5) / (12.0 * far)  # its sum of powers, without their rounding
    return jnp.where(z <= 1.0, inner, outer)


def localise_by_position(
    model: CompiledModel, positions: Mapping[str, Any], radius: float, *, period: float | None = None
) -> Localisation:
    """Taper by the distance between positions of sites.

    Args:
        model: The compiled model.
        positions: For each site of the state and of the observation the position of each of its entries: an array of the
            site's shape, or with one more axis for positions in several dimensions.
        radius: Distance from which on nothing is correlated, 2 c.
        period: Circumference, where positions are on a circle.

    Returns:
        The tapers, of :func:`gaspari_cohn`.

    Raises:
        ValueError: A radius that is not positive; a site without positions, or positions of another shape.
    """
    if not radius > 0:
        raise ValueError(f"radius is {radius}. Expected a positive distance.")
    states = _positions({name: site.shape for name, site in model.sites.items()}, positions)
    data = _positions({name: site.shape for name, site in model.observation_sites.items()}, positions)

    def taper(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        apart = np.abs(one[:, None] - other[None])
        if period is not None:
            apart = np.minimum(apart % period, period - apart % period)
        return np.asarray(gaspari_cohn(jnp.asarray(2.0 * np.linalg.norm(apart, axis=-1) / radius)))

    return Localisation(taper(states, data), taper(data, data))


def localise_by_name(model: CompiledModel, taper: Callable[[str, str], float]) -> Localisation:
    """Taper by a function of two names of entries, such as ``x[3]`` and ``y[0]``.

    Args:
        model: The compiled model.
        taper: From the names of two entries, of the state and the data or both of the data, to a number in [0, 1].
    """
    states, data = model.coordinate_names, _data_names(model)
    values = {(one, other): float(taper(one, other)) for other in data for one in (*states, *data)}
    tapers = Localisation(*(np.array([[values[one, other] for other in data] for one in rows]) for rows in (states, data)))
    return check_localisation(model, tapers)


def check_localisation(model: CompiledModel, localisation: Localisation) -> Localisation:
    """Refuse tapers that are not those of the model's sites.

    Raises:
        ValueError: Another shape, a value outside [0, 1], or data that are not wholly correlated with themselves.
    """
    size = len(_data_names(model))
    for name, wanted in (("states", (model.dimension, size)), ("data", (size, size))):
        array = np.asarray(getattr(localisation, name))
        if array.shape != wanted:
            raise ValueError(f"The localisation's {name} have shape {array.shape}. Expected {wanted}.")
        if not ((array >= 0) & (array <= 1)).all():
            raise ValueError(f"The localisation's {name} have values outside [0, 1].")
    data = np.asarray(localisation.data)
    if not (np.allclose(data, data.T) and np.allclose(np.diagonal(data), 1.0)):
        raise ValueError("The localisation's data are no correlations. Expected a symmetric matrix with ones on the diagonal.")
    return localisation


def _data_names(model: CompiledModel) -> list[str]:
    """Names of the k data, in the order of `flat_observation`."""
    return [
        f"{name}[{','.join(map(str, index))}]" if site.shape else name
        for name, site in model.observation_sites.items()
        for index in np.ndindex(*site.shape)
    ]


def _positions(shapes: Mapping[str, tuple[int, ...]], positions: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    """Positions (n, p) of all entries of the sites in order."""
    parts = []
    for name, shape in shapes.items():
        if name not in positions:
            raise ValueError(f"positions lacks the site {name!r}. Expected {list(shapes)}.")
        array = np.asarray(positions[name], float)
        if array.shape[: len(shape)] != shape or array.ndim > len(shape) + 1:
            raise ValueError(f"Positions of {name!r} have shape {array.shape}. Expected {shape}, or that with one more axis.")
        parts.append(array.reshape(int(np.prod(shape)), -1))
    return np.concatenate(parts)
