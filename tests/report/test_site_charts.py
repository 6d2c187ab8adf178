"""The report of a model of one's own: its data, its sites in their own values, their names and units."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr
from page_reading import data_of

import poseppl
from poseppl.report import report_html
from poseppl.report.run_page import data_charts, site_charts

FRAMES = 8
HEIGHTS = np.array([0.1, 0.3, np.nan, 2.2, 2.0, 2.3, 2.5, 0.2])


def _initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))
    numpyro.sample("busy", dist.Bernoulli(0.5))
    numpyro.sample("rate", dist.LogNormal(0.0, 0.3))


def _transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.9 * state["level"], 0.3))
    numpyro.sample("busy", dist.Bernoulli(jnp.where(state["busy"] == 1, 0.9, 0.1)))
    numpyro.sample("rate", dist.LogNormal(0.9 * jnp.log(state["rate"]), 0.2))


def _observation(params, state, inputs):
    numpyro.sample("height", dist.Normal(state["level"] + 2.0 * state["busy"], 0.3))
    numpyro.sample("pair", dist.Normal(jnp.array([1.0, 2.0]) * state["rate"], 0.3).to_event(1))


@pytest.fixture(scope="module")
def tank() -> xr.DataTree:
    model = poseppl.StateSpaceModel(_initial, _transition, _observation).compile()
    data = {"height": HEIGHTS, "pair": np.ones((FRAMES, 2))}
    told = {"model": "water tank", "units": {"level": "m", "height": "m", "rate": "l/s"}}
    truth = np.stack([np.zeros(FRAMES), np.linspace(0, 1, FRAMES), np.zeros(FRAMES)], 1)
    order = [model.coordinate_names.index(name) for name in ("busy", "level", "rate")]
    filter = poseppl.particle_filter(model, 300)
    result = poseppl.infer(model, data, filter, jax.random.key(0), truth=truth[:, np.argsort(order)], attrs=told)
    return poseppl.add_predictive(result, model, jax.random.key(1))


def _lines(chart) -> dict[str, np.ndarray]:
    return {trace.name: np.asarray(trace.y, float) for trace in chart.data if trace.showlegend is not False}


@pytest.mark.full
def test_data_stand_on_what_is_predicted_of_them(tank: xr.DataTree) -> None:
    charts = data_charts(tank)
    assert list(charts) == ["height", "pair[0]", "pair[1]"]
    assert charts["height"].layout.yaxis.title.text == "m"
    lines, draws = _lines(charts["height"]), tank["posterior_predictive/height"].values.reshape(-1, FRAMES)
    np.testing.assert_allclose(lines["data"], HEIGHTS, rtol=1e-6)
    np.testing.assert_allclose(lines["predicted, central 90 %"], np.quantile(draws, 0.95, axis=0), rtol=1e-5)
    pair = tank["posterior_predictive/pair"].values.reshape(-1, FRAMES, 2)[..., 1]
    np.testing.assert_allclose(_lines(charts["pair[1]"])["predicted, median"], np.median(pair, axis=0), rtol=1e-5)


@pytest.mark.full
def test_sites_are_drawn_in_their_own_values(tank: xr.DataTree) -> None:
    charts = site_charts(tank)
    assert set(charts) == {"busy", "level", "rate"}
    assert charts["rate"].layout.yaxis.title.text == "l/s"
    draws = tank["posterior/rate"].values.reshape(-1, FRAMES)
    assert (draws > 0).all() and (tank["unconstrained_posterior/state"].values.min() < 0)
    rate = _lines(charts["rate"])
    np.testing.assert_allclose(rate["posterior mean"], draws.mean(0), rtol=0.1)
    assert "truth" not in rate, "the truth that is known is that of its logarithm"
    level = _lines(charts["level"])
    np.testing.assert_allclose(level["posterior mean"], tank["summary/level_mean"].values, rtol=1e-6)
    np.testing.assert_allclose(level["truth"], np.linspace(0, 1, FRAMES), atol=1e-6)
    busy = _lines(charts["busy"])
    np.testing.assert_allclose(busy["0"] + busy["1"], 100.0, rtol=1e-4)
    np.testing.assert_allclose(busy["1"], 100 * tank["summary/busy_probability"].values[:, 1], rtol=1e-5)


@pytest.mark.full
def test_the_page_is_headed_by_the_model_and_shows_both(tank: xr.DataTree) -> None:
    page = report_html(tank)
    assert "<h1>water tank</h1>" in page and "Tracking" not in page.split("<script")[0]
    assert [f"<h2>{title}</h2>" in page for title in ("Data", "State", "Poses", "Coordinates")] == [True, True, False, False]
    assert list(data_of(page, "charts-data")["data"]) == ["height", "pair[0]", "pair[1]"]
