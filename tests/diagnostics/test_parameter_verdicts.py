"""Verdicts on learned parameters without a truth: a model that is right, one of a wrong transition, chains that differ."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr

from poseppl import StateSpaceModel, kalman_filter, log_likelihood
from poseppl.diagnostics.parameters import check_parameters, predictions_under
from poseppl.errors import InputError

FRAMES = 120
STEP, NOISE = 1.0, 0.5


def parameters() -> None:
    numpyro.sample("noise", dist.LogNormal(0.0, 1.0))


def initial(params: Any, inputs: Any) -> None:
    numpyro.sample("x", dist.Normal(0.0, 1.0))


def transition(params: Any, state: Any, inputs: Any) -> None:
    numpyro.sample("x", dist.Normal(state["x"], inputs))


def observation(params: Any, state: Any, inputs: Any) -> None:
    numpyro.sample("y", dist.Normal(state["x"], params["noise"]))


MODEL = StateSpaceModel(initial, transition, observation, parameters).compile(1.0)


@pytest.fixture(scope="module")
def data() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    walk = np.concatenate([rng.standard_normal(1), STEP * rng.standard_normal(FRAMES - 1)]).cumsum()
    return {"y": walk + NOISE * rng.standard_normal(FRAMES)}


def posterior(data: dict[str, np.ndarray], step: float) -> dict[str, np.ndarray]:
    """Independent draws of the noise, (4, 100), from its posterior on a grid, under steps of a given size."""
    grid, steps = np.geomspace(0.1, 5.0, 60), jnp.full(FRAMES, step)
    observations = MODEL.observe(data)
    values = LIKELIHOODS(jnp.asarray(grid), observations, steps)
    weights = np.exp(np.asarray(values, float) - float(np.max(values)) - np.log(grid) ** 2 / 2)
    draws = np.random.default_rng(1).choice(grid, size=(4, 100), p=weights / weights.sum())
    return {"noise": draws * np.exp(0.01 * np.random.default_rng(2).standard_normal(draws.shape))}


LIKELIHOODS = jax.jit(
    lambda grid, observations, steps: jax.vmap(
        lambda noise: log_likelihood(MODEL, {"noise": noise}, observations, kalman_filter, inputs=steps)
    )(grid)
)


@pytest.mark.full
@pytest.mark.parametrize(("step", "wrong"), [(STEP, False), (0.1, True)])
def test_a_model_whose_steps_are_too_small_is_an_error_whatever_its_noise(
    data: dict[str, np.ndarray], step: float, wrong: bool
) -> None:
    draws = posterior(data, step)
    predictions = predictions_under(MODEL, draws, data, kalman_filter, jax.random.key(0), jnp.full(FRAMES, step), num_draws=5)
    found = check_parameters(draws, predictions)
    assert [each.severity for each in found] == (["error"] if wrong else [])
    assert all(each.text.startswith("Under ") for each in found)


def test_chains_that_do_not_agree() -> None:
    rng = np.random.default_rng(3)
    draws = rng.standard_normal((4, 200, 2))
    assert check_parameters({"a": draws}) == []
    shifted = {"a": draws + np.arange(4)[:, None, None]}
    (apart,) = check_parameters(shifted)
    assert check_parameters(
        xr.DataTree.from_dict({"posterior": xr.Dataset({"a": (("chain", "draw", "of_a"), shifted["a"])})})
    ) == [apart]
    assert apart.severity == "error" and "do not agree" in apart.text
    slow = np.zeros((4, 400))
    for t in range(1, 400):
        slow[:, t] = 0.9 * slow[:, t - 1] + rng.standard_normal(4)
    assert [each.severity for each in check_parameters({"b": slow})] == ["warning"]
    (alone,) = check_parameters({"b": np.cumsum(slow[:1], 1)})  # one chain: nothing to compare it with, and no warning of NumPy
    assert alone.severity == "error" and "means and intervals are unusable" in alone.text


def test_chains_that_stand_still_or_are_not_finite_are_errors() -> None:
    draws = np.random.default_rng(4).standard_normal((4, 200))
    factor = np.stack([np.ones_like(draws), draws], -1)  # an entry that is constant by its nature, as of a Cholesky factor
    assert check_parameters({"a": factor}) == []
    draws[2] = 0.3
    (still,) = check_parameters({"a": draws})
    assert still.severity == "error" and "1 of 4 chains of a never moved" in still.text
    draws[1, 7] = np.nan
    (infinite,) = check_parameters({"a": draws})
    assert infinite.severity == "error" and "not finite" in infinite.text
    with pytest.raises(InputError, match=r"a: draws of shape \(800,\) .expected \(chain, draw, ...\)"):
        check_parameters({"a": draws.ravel()})
