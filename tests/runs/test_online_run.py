"""A run whose frames come one after the other gives what the whole sequence gives, and compiles nothing twice."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np
import pytest
from test_run import Controls, counted, driven_model, failing

import poseppl
from poseppl.filters import particle_filter
from poseppl.runs.online_run import OnlineRun
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.run import Constant, RunError, run_filter

KEY = jax.random.key(3)
MODEL = driven_model().compile(Controls(0.0, 1.0))
Y = np.sin(np.arange(9.0))


def rows(start: int, stop: int) -> tuple[Any, Any]:
    inputs: Any = Controls(np.arange(start, stop) / 10, Constant(np.float32(1.0)))
    return MODEL.observe({"y": Y[start:stop]}), inputs


@pytest.mark.parametrize(
    "ends", [(4, 7, 9), *(pytest.param(ends, marks=pytest.mark.full) for ends in ((1, 2, 3, 4, 5, 6, 7, 8, 9), (9,)))]
)
def test_parts_give_what_the_sequence_gives(ends: tuple[int, ...]) -> None:
    filter, count = counted(particle_filter(MODEL, 8))
    filter = dataclasses.replace(filter, model=MODEL)
    how: Any = {"collect": poseppl.collect_history, "predict": predictive_checks(MODEL, 16)}
    whole = run_filter(filter, KEY, *rows(0, 9), **how)
    fed = OnlineRun(filter, KEY, *rows(0, ends[0]), **how, note=pytest.fail)
    kept = [fed.first, *(fed.add(*rows(start, stop)) for start, stop in zip(ends, ends[1:], strict=False))]
    run = fed.finish()
    assert count == {"init": 1, "step": 1}
    for name in ("outputs", "info", "unique_ancestors", "state"):
        jax.tree.map(np.testing.assert_array_equal, getattr(run, name), getattr(whole, name))
    # a scan of one frame is another program, in which XLA may round a sum otherwise
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6), run.prediction, whole.prediction)
    parts = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(each.outputs for each in kept))
    jax.tree.map(np.testing.assert_array_equal, parts, run.outputs)


@pytest.mark.full
def test_a_state_that_is_not_finite_ends_it_and_what_was_done_is_kept() -> None:
    model, filter = failing(2, broken=True)
    data = model.observe({"y": np.zeros((1, 2))})
    fed = OnlineRun(filter, KEY, data, collect=poseppl.collect_history, note=lambda message: None, frame_numbers=[7])
    fed.add(data, frame_numbers=[8])
    with pytest.raises(RunError, match="frame 9.*not finite") as caught:
        fed.add(data, frame_numbers=[9])
    assert caught.value.frame == 9 and caught.value.done is not None
    assert len(fed.finish().info.ess) == 2


@pytest.mark.full
def test_data_of_another_shape_are_refused() -> None:
    fed = OnlineRun(particle_filter(MODEL, 8), KEY, *rows(0, 2), collect=poseppl.collect_history, note=pytest.fail)
    with pytest.raises(ValueError, match="Expected an Observation"):
        fed.add({"y": 0.0})  # type: ignore[arg-type]
    data, inputs = rows(2, 4)
    with pytest.raises(ValueError, match="leading axis of 2 frames"):
        fed.add(data, inputs._replace(drift=np.zeros(3)))
