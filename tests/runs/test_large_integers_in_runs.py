"""Integer states beyond 2^24 in float32: exact in results, or the run says that they are not."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.errors import PosepplError
from poseppl.program import StateSpaceModel
from poseppl.runs.batch import infer_batch
from poseppl.runs.contents import names_of
from poseppl.runs.online import Online
from poseppl.runs.run import RunError
from poseppl.runs.simulation import simulate

PEOPLE = 54_321_987


def count(params, state, inputs):
    """People who are born and die, one at a time, and how many did."""
    born, dead = (numpyro.sample(name, dist.Poisson(rate)) for name, rate in (("born", 3.0), ("dead", 2.0)))
    people, change = (PEOPLE, 0) if state is None else (state["people"], state["change"])
    numpyro.sample("people", dist.Delta(people + born - dead))
    numpyro.sample("change", dist.Delta(change + born - dead))


def registered(params, state, inputs):
    numpyro.sample("y", dist.Poisson(0.5 + state["born"]))


COUNTRY = StateSpaceModel(lambda params, inputs: count(params, None, inputs), count, registered)
DATA = {"y": np.array([4.0, 2.0, np.nan, 3.0, 1.0, 2.0])}


@pytest.fixture(scope="module")
def country():
    return COUNTRY.compile()


@pytest.fixture(scope="module")
def filtered(country):
    return poseppl.infer(country, DATA, poseppl.particle_filter(country, 200), jax.random.key(0))


def constant(tree, group):
    people, change = (tree[f"{group}/{name}"].values.astype(np.int64) for name in ("people", "change"))
    assert np.ptp(change) > 3
    return np.all(people - change == PEOPLE)


@pytest.mark.full
def test_every_draw_is_exact(filtered):
    assert constant(filtered, "posterior")
    assert "people (rest)" in names_of(filtered, "state_dim")


def test_moments_are_those_of_the_changes(filtered):
    summary = filtered["summary"]
    np.testing.assert_allclose(summary["people_sd"], summary["change_sd"], rtol=1e-5)
    np.testing.assert_allclose(summary["people_mean"], PEOPLE + summary["change_mean"], rtol=1e-7)
    np.testing.assert_allclose(summary["people_quantile"], PEOPLE + summary["change_quantile"], rtol=1e-7)


@pytest.mark.full
def test_smoothed_draws_are_exact(country, filtered):
    smoothed = poseppl.smooth(filtered, poseppl.backward_simulation_smoother(country, 50), jax.random.key(1))
    assert constant(smoothed, "posterior")


def test_forecasts_are_exact(country, filtered):
    assert constant(poseppl.forecast(filtered, country, 4, jax.random.key(2)), "forecast")


@pytest.mark.full
def test_simulated_states_are_exact(country):
    states = simulate(country, jax.random.key(3), 6).states
    sites = jax.vmap(country.to_sites)(states)
    np.testing.assert_array_equal(sites["people"] - sites["change"], PEOPLE)


def doubling(params, state, inputs):
    """A culture that starts small, and doubles."""
    numpyro.sample("cells", dist.Delta(jnp.int32(1001) if state is None else 2 * state["cells"]))


def weighed(params, state, inputs):
    numpyro.sample("y", dist.Normal(0.0, 1.0))


CULTURE = StateSpaceModel(lambda params, inputs: doubling(params, None, inputs), doubling, weighed)
FIRST_BEYOND = 15  # 1001 * 2^14 is below 2^24


def test_a_run_stops_where_an_integer_is_no_longer_exact():
    model = CULTURE.compile()
    with pytest.raises(RunError, match=f"frame {FIRST_BEYOND}: integers of site 'cells' .*jax_enable_x64") as raised:
        poseppl.infer(model, {"y": np.zeros(20)}, poseppl.particle_filter(model, 20), jax.random.key(0))
    assert raised.value.frame == FIRST_BEYOND
    with jax.enable_x64(True):
        model = CULTURE.compile()
        found = poseppl.infer(model, {"y": np.zeros(20)}, poseppl.particle_filter(model, 20), jax.random.key(0))
    np.testing.assert_array_equal(found["posterior/cells"].values[0, 0], 1001 * 2 ** np.arange(20))


def from_inputs(params, state, inputs):
    numpyro.sample("cells", dist.Delta(inputs if state is None else state["cells"] - 1))


@pytest.mark.full
def test_online_and_batches_and_simulations_say_so_too(caplog):
    model = StateSpaceModel(lambda params, inputs: from_inputs(params, None, inputs), from_inputs, weighed).compile(np.int32(0))
    filter = poseppl.particle_filter(model, 20)
    with pytest.raises(RunError, match="'cells'"):
        Online(filter, jax.random.key(0)).update(model.observe({"y": 0.0}), np.int32(PEOPLE))
    with pytest.raises(PosepplError, match="'cells'"):
        simulate(model, jax.random.key(0), 3, np.full(3, PEOPLE, np.int32))
    infer_batch(model, {"y": np.zeros((2, 3))}, filter, jax.random.key(0), np.full((2, 3), PEOPLE, np.int32))
    assert "integers beyond 2^24" in caplog.text


@pytest.mark.full
def test_a_forecast_says_so_too():
    model = CULTURE.compile()
    found = poseppl.infer(model, {"y": np.zeros(10)}, poseppl.particle_filter(model, 20), jax.random.key(0))
    with pytest.raises(PosepplError, match="'cells'"):
        poseppl.forecast(found, model, 10, jax.random.key(1))
