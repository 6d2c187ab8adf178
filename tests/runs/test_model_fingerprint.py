"""A result is not taken on under other params than those that it was filtered under."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.runs.model_fingerprint import FINGERPRINT, fingerprint_of
from poseppl.runs.posterior_checks import check_posterior
from poseppl.runs.results import load_result, save_result
from poseppl.smoothers import rauch_tung_striebel_smoother

KEY = jax.random.key(0)
DATA = {"y": np.array([0.3, 0.1, np.nan, -0.4])}


def programs() -> poseppl.StateSpaceModel:
    return poseppl.StateSpaceModel(
        lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 1.0)),
        lambda params, state, inputs: numpyro.sample("x", dist.Normal(state["x"], params["q"])),
        lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 0.3)),
    )


def compiled(q: float) -> poseppl.CompiledModel:
    return programs().compile(None, {"q": q})


@pytest.fixture(scope="module")
def result() -> Any:
    return poseppl.infer(compiled(1.0), DATA, poseppl.kalman_filter, KEY)


def test_a_smoother_of_other_params_is_refused(result, tmp_path):
    """Also for a result of a file. The same params, compiled again, are accepted, and so is a result without a fingerprint."""
    other = rauch_tung_striebel_smoother(compiled(0.05))
    save_result(result, tmp_path / "result.nc")
    for found in (result, load_result(tmp_path / "result.nc")):
        with pytest.raises(ValueError, match="filtered under other params") as raised:
            poseppl.smooth(found, other, KEY)
        assert "\n" not in str(raised.value)
    smoothed = poseppl.smooth(result, rauch_tung_striebel_smoother(compiled(1.0)), KEY)
    assert smoothed.attrs[FINGERPRINT] == result.attrs[FINGERPRINT]
    for call in (check_posterior, poseppl.add_predictive):
        with pytest.raises(ValueError, match="filtered under other params"):
            call(smoothed, compiled(0.05), KEY)
    old = result.copy()
    old.attrs = {name: value for name, value in result.attrs.items() if name != FINGERPRINT}
    assert poseppl.smooth(old, other, KEY)["posterior"].sizes["frame"] == 4


@pytest.mark.full
def test_series_of_a_batch_know_their_model():
    batch = poseppl.infer_batch(compiled(1.0), [DATA, DATA], poseppl.kalman_filter, KEY)
    with pytest.raises(ValueError, match="filtered under other params"):
        poseppl.smooth(poseppl.one_series(batch, 0), rauch_tung_striebel_smoother(compiled(0.05)), KEY)


def test_a_fingerprint_is_of_values_and_names():
    """The same for a number and arrays of it; another for other values, shapes or names; none for what is traced."""
    one = fingerprint_of(compiled(1.0))
    assert one == fingerprint_of(compiled(np.float64(1.0))) == fingerprint_of(compiled(jnp.ones(())))
    others = ({"q": 2.0}, {"q": np.ones(1)}, {"r": 1.0}, {"q": 1.0, "r": 1.0}, None)
    assert len({*map(str, (one, *(fingerprint_of(compiled(1.0).with_params(params)) for params in others)))}) == 6
    assert fingerprint_of(compiled(1.0).with_params({"q": 1.0, "name": print})) == fingerprint_of(
        compiled(1.0).with_params({"q": 1.0, "name": repr})
    )
    traced = []
    jax.eval_shape(lambda q: traced.append(fingerprint_of(compiled(1.0).with_params({"q": q}))), 1.0)
    assert traced == [{}]
