"""The linear Gaussian model, whose filtering distributions and evidence a Kalman filter knows exactly.

    x_0 ~ N(m, P),    x_t = A x_(t-1) + B u_t + N(0, Q),    y_t = H x_t + N(0, R)

State site `x` (d,), data site `y` (k,); `inputs` is u_t, a vector, when B is given, and None otherwise. With a diagonal R the
entries of y are masked one by one, otherwise together.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from poseppl.arrays import Floats
from poseppl.program import StateSpaceModel

Matrix = Any


class LinearGaussian(NamedTuple):
    """The matrices of the model, as NumPy arrays."""

    A: Floats
    Q: Floats
    H: Floats
    R: Floats
    m: Floats
    P: Floats
    B: Floats | None


def linear_gaussian_matrices(dimension: int = 1, num_observed: int | None = None, **given: Matrix | None) -> LinearGaussian:
    """Fill in defaults: a damped chain of coordinates, its first `num_observed` (all) seen with noise.

    Args:
        dimension: d.
        num_observed: k, the rows of the default H.
        given: Those that differ. For the transition A (d, d), by default 0.9 on the diagonal and 0.1 above it, and Q (d, d),
            0.25 I; of the observation H (k, d), the first k rows of the identity, and R (k, k), 0.25 I; of the first state
            m (d,), 0, and P (d, d), I; B (d, l) of the inputs, of which there are none by default.

    Raises:
        ValueError: Shapes that do not fit together.
    """
    known = {name: np.asarray(matrix, float) for name, matrix in given.items() if matrix is not None}
    d = len(known["A"]) if "A" in known else dimension
    k = len(known["H"]) if "H" in known else (num_observed or d)
    chain, eye = 0.9 * np.eye(d) + 0.1 * np.eye(d, k=1), np.eye(d)
    filled = LinearGaussian(chain, 0.25 * eye, np.eye(k, d), 0.25 * np.eye(k), np.zeros(d), eye, None)._replace(**known)
    expected = {"A": (d, d), "Q": (d, d), "H": (k, d), "R": (k, k), "m": (d,), "P": (d, d)}
    for name, shape in expected.items():
        if getattr(filled, name).shape != shape:
            raise ValueError(f"{name} has shape {getattr(filled, name).shape}. Expected {shape}.")
    if filled.B is not None and (filled.B.ndim != 2 or filled.B.shape[0] != d):
        raise ValueError(f"B has shape {filled.B.shape}. Expected ({d}, number of inputs).")
    return filled


def linear_gaussian(dimension: int = 1, num_observed: int | None = None, **matrices: Matrix) -> StateSpaceModel:
    """Build the model; arguments as in `linear_gaussian_matrices`."""
    return linear_gaussian_model(linear_gaussian_matrices(dimension, num_observed, **matrices))


def linear_gaussian_model(matrices: LinearGaussian) -> StateSpaceModel:
    """Build the model from its matrices."""
    A, _, H, _, m, _, B = matrices

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", _gaussian(jnp.asarray(m), matrices.P).to_event(1 - _is_full(matrices.P)))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        mean = jnp.asarray(A) @ state["x"]
        if B is not None:
            mean = mean + jnp.asarray(B) @ inputs
        numpyro.sample("x", _gaussian(mean, matrices.Q).to_event(1 - _is_full(matrices.Q)))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", _gaussian(jnp.asarray(H) @ state["x"], matrices.R))

    return StateSpaceModel(initial, transition, observation)


def _is_full(covariance: Floats) -> bool:
    return bool(np.any(covariance != np.diag(np.diagonal(covariance))))


def _gaussian(mean: Any, covariance: Floats) -> dist.Distribution:
    if _is_full(covariance):
        return dist.MultivariateNormal(mean, scale_tril=jnp.asarray(np.linalg.cholesky(covariance)))
    return dist.Normal(mean, jnp.asarray(np.sqrt(np.diagonal(covariance))))
