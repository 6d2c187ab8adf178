"""The evidence by Laplace's approximation: exact for a linear Gaussian model, from any trajectory, with its gradient."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from oracles.kalman import kalman_filter
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices
from scipy.integrate import quad
from scipy.stats import norm, t

from poseppl.compilation import double_precision
from poseppl.program import Cluttered, StateSpaceModel
from poseppl.smoothers.curvature import find_mode
from poseppl.smoothers.laplace import laplace_evidence

DATA = np.array([[0.3], [0.9], [np.nan], [1.4], [0.2]])


@pytest.fixture(autouse=True)
def _double_precision() -> Iterator[None]:
    with double_precision():
        yield


def walk(observe: Any) -> StateSpaceModel:
    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(jnp.zeros(1), 1.2))

    def transition(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(0.8 * state["x"], params["step"]))

    def observation(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("y", observe(params, state["x"]))

    return StateSpaceModel(initial, transition, observation)


def exact(step: float, noise: float) -> float:
    matrices = linear_gaussian_matrices(1, A=[[0.8]], Q=[[step**2]], R=[[noise**2]], P=[[1.2**2]])
    return float(kalman_filter(matrices, DATA, np.isfinite(DATA)).log_evidence.sum())


def test_it_is_kalmans_for_a_linear_model_with_its_gradient() -> None:
    model = walk(lambda params, x: dist.Normal(x, params["noise"])).compile(params={"step": 0.5, "noise": 0.7})
    observed, somewhere = model.observe({"y": DATA}), jnp.asarray(np.random.default_rng(0).normal(size=(5, 1)))

    def evidence(params: Any) -> Any:
        return laplace_evidence(model.with_params(params), somewhere, observed, None)

    value, gradient = jax.jit(jax.value_and_grad(evidence))({"step": 0.5, "noise": 0.7})
    assert np.isclose(value, exact(0.5, 0.7), rtol=1e-9)
    differences = {"step": exact(0.5001, 0.7) - exact(0.4999, 0.7), "noise": exact(0.5, 0.7001) - exact(0.5, 0.6999)}
    assert all(np.isclose(gradient[name], differences[name] / 2e-4, rtol=1e-5) for name in differences)


@pytest.mark.full
@pytest.mark.parametrize("datum", [0.4, 1.5])
def test_one_robust_point(datum: float) -> None:
    """Laplace's formula, with the curvature from differences; against quadrature it is an approximation, good to a sixth."""
    model = walk(lambda params, x: Cluttered(dist.Normal(x, 0.5), 5.0, -3.0, 40.0)).compile(params={"step": 0.5})
    share = 1 / (1 + np.exp(3.0))

    def density(x: float) -> float:
        return float(norm(0, 1.2).pdf(x) * ((1 - share) * t(5.0, x, 0.5).pdf(datum) + share / 40))

    observed = model.observe({"y": np.array([[datum]])})
    mode = find_mode(model, jnp.zeros((1, 1)), observed, None, 20)
    found, at, step = float(laplace_evidence(model, mode, observed, None)), float(mode[0, 0]), 1e-3
    low, middle, high = (np.log(density(at + move)) for move in (-step, 0.0, step))
    curvature = -(low - 2 * middle + high) / step**2
    assert np.isclose(found, middle + 0.5 * np.log(2 * np.pi / curvature), atol=1e-5)
    assert abs(found - np.log(quad(density, -8, 8)[0])) < 1 / 6


@pytest.mark.slow
def test_the_gradient_is_finite_where_a_datum_counts_nothing() -> None:
    model = walk(lambda params, x: Cluttered(dist.Normal(x, params["noise"]).to_event(1), 5.0, -3.0, 1e4)).compile(
        params={"step": 0.5, "noise": 0.1}
    )
    observed = model.observe({"y": np.array([[0.0], [900.0], [0.1]])})

    def evidence(params: Any) -> Any:
        return laplace_evidence(model.with_params(params), jnp.zeros((3, 1)), observed, None)

    gradient = jax.grad(evidence)({"step": 0.5, "noise": 0.1})
    assert all(np.isfinite(value) for value in gradient.values())
