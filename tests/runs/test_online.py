"""A filter fed frame by frame: what it is given and what comes of it are checked, and nothing is compiled twice."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_run import Controls, counted, driven_model, failing

import poseppl
from poseppl.filters import particle_filter
from poseppl.runs.online import Online
from poseppl.runs.run import Constant, RunError, run_filter

KEY = jax.random.key(0)
MODEL = driven_model().compile(Controls(0.0, 1.0))


@pytest.mark.full
def test_numbers_of_any_kind_are_compiled_for_once() -> None:
    """Python numbers are of a weak dtype, and integers of another than floats."""
    plain = particle_filter(MODEL, 8)
    filter, count = counted(plain)
    online = Online(dataclasses.replace(filter, model=MODEL), KEY)
    for drift in (1, 0.5, np.float64(0.5), jnp.asarray(0.5), np.int64(2), jnp.float32(1)):
        online.update({"y": 0.3}, Controls(drift, 1))
    assert count == {"init": 1, "step": 1}


@pytest.mark.full
def test_constants_of_any_kind_are_compiled_for_once() -> None:
    filter, count = counted(particle_filter(MODEL, 8))
    for scale in (1.0, np.float32(1.0), jnp.asarray(1.0), jnp.ones(())):
        inputs: Any = Controls(np.arange(3.0), Constant(scale))
        run_filter(filter, KEY, MODEL.observe({"y": np.zeros(3)}), inputs, collect=poseppl.collect_history)
    assert count == {"init": 1, "step": 1}


@pytest.mark.parametrize("at", [pytest.param(1, marks=pytest.mark.full), 3])
def test_a_state_that_is_not_finite_is_refused_and_the_one_before_it_kept(at: int) -> None:
    model, filter = failing(at, broken=True)
    online = Online(filter, KEY)
    data = model.observe({"y": np.zeros(2)})
    for _ in range(at):
        state, _ = online.update(data)
    with pytest.raises(RunError, match=f"frame {at}.*not finite") as caught:
        online.update(data)
    assert caught.value.frame == online.frame == at
    assert online.state is state and np.isfinite(online.state.particles).all()


@pytest.mark.full
def test_data_and_inputs_of_other_shapes_are_refused() -> None:
    """A sequence in place of a frame would broadcast in silence."""
    online = Online(particle_filter(MODEL, 8), KEY)
    inputs = Controls(0.0, 1.0)
    with pytest.raises(ValueError, match=r"\(4,\).*Expected those of one frame"):
        online.update({"y": np.zeros(4)}, inputs)
    with pytest.raises(ValueError, match="compiled for"):
        online.update({"y": 0.0})
    with pytest.raises(ValueError, match="compiled for"):
        online.update({"y": 0.0}, Controls(np.zeros(3), 1.0))
    with pytest.raises(ValueError, match="Expected an Observation"):
        online.update(0.3, inputs)
    assert online.frame == 0 and online.state is None


@pytest.mark.full
def test_data_of_another_model_are_refused_by_a_run() -> None:
    data = MODEL.observe({"y": np.zeros(4)})
    data = data._replace(values={"y": jnp.zeros((4, 2))}, mask={"y": jnp.ones((4, 2), bool)})
    with pytest.raises(ValueError, match=r"Expected those of 4 frames of the model's sites: \{'y': \(4,\)\}"):
        run_filter(particle_filter(MODEL, 8), KEY, data, Controls(np.zeros(4), Constant(1.0)), collect=poseppl.collect_history)
