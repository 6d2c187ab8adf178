"""Warnings of a run are in its result, and among the verdicts."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.program import StateSpaceModel
from poseppl.program.frame_inputs import Constant, coarse_inputs
from poseppl.runs.batch import infer_batch
from poseppl.runs.course import breakdown_message
from poseppl.runs.online_run import OnlineRun
from poseppl.runs.results import provenance

START = 1_700_000_000.0
STEPS = np.arange(6.0)


def level(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.0 if state is None else state["level"], 1.0))


def height(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["level"], 0.5))


def visits(params, state, inputs):
    numpyro.sample("y", dist.BetaBinomial(jnp.exp(state["level"]), 1.0, 500_000))


def model(observation=height, inputs=None):
    return StateSpaceModel(lambda params, inputs: level(params, None, inputs), level, observation).compile(inputs)


def run(compiled, y, inputs=None, num_particles=100):
    return poseppl.infer(compiled, {"y": y}, poseppl.particle_filter(compiled, num_particles), jax.random.key(0), inputs)


def only_warning(result):
    (text,) = provenance(result)["warnings"]
    (verdict,) = [verdict for verdict in poseppl.verdicts(result) if text in verdict.text]
    assert verdict.severity == "warning"
    return text


def test_data_that_are_rounded(caplog):
    compiled = model()
    for _ in range(2):  # the second run is warned of in its result, too
        result = run(compiled, 2e7 + STEPS)
        warned = [text for text in provenance(result)["warnings"] if "rounding decides" in text]
        assert len(warned) == 1 and "observation 'y'" in warned[0]
    assert sum("rounding decides" in text for text in caplog.messages) == 1


@pytest.mark.full
def test_densities_that_are_rounded():
    text = only_warning(run(model(visits), 400_000 + np.arange(3), num_particles=2000))
    assert "'y'" in text and "jax_enable_x64" in text


@pytest.mark.full
def test_a_filter_that_collapsed():
    text = only_warning(run(model(), np.full(3, 30.0)))
    assert "fewer than 2 of 100 particles are effective" in text
    smoothed = poseppl.smooth(
        run(model(), np.full(3, 30.0)), poseppl.backward_simulation_smoother(model(), 20), jax.random.key(1)
    )
    assert provenance(smoothed)["warnings"]


def test_nothing_to_warn_of():
    assert "warnings" not in provenance(run(model(), STEPS))


def test_times_whose_steps_float32_does_not_know():
    inputs = {"time": START + STEPS, "gain": np.ones(6)}
    text = only_warning(run(model(inputs={"time": 0.0, "gain": 1.0}), STEPS, inputs))
    assert text.startswith("inputs['time']: numbers as large as 1700000005 are 128 apart in float32, and change by 1 ")
    assert "Subtract a start" in text and "jax_enable_x64" in text


@pytest.mark.parametrize(
    ("values", "warned"),
    [
        (START + 60 * STEPS, True),
        (START + 3600.0 * STEPS, False),
        (STEPS, False),
        (np.full(6, START), False),
        ((START + STEPS).astype(np.float32), False),
        (np.stack([STEPS, 1e9 + 0.5 * STEPS], 1), True),
        (0.1 + 1e-17 * STEPS, False),
        (Constant(START), False),
        (1e6 + np.array([0.0, 0.0, 0.01, 0.01, 0.02, 0.02]), True),
        (np.array([START]), False),
    ],
)
def test_which_inputs_are_coarse(values, warned):
    assert bool(coarse_inputs({"u": values})) == warned
    with jax.enable_x64(True):
        assert not coarse_inputs({"u": values})


def test_integers_that_would_wrap_around():
    compiled = model(inputs=0)
    run(compiled, STEPS, 1_700_000_000 + np.arange(6))
    with pytest.raises(ValueError, match="integers up to 1700000000005, which do not fit int32. Subtract a start"):
        run(compiled, STEPS, 1_700_000_000_000 + np.arange(6))


def test_frames_that_come_one_by_one():
    compiled = model(inputs=0.0)
    said = []
    online = OnlineRun(
        poseppl.particle_filter(compiled, 50),
        jax.random.key(0),
        compiled.observe({"y": STEPS}),
        START + STEPS,
        collect=lambda *row: row[1].particles,
        note=said.append,
    )
    assert online.finish().warnings == tuple(said) and "inputs" in said[0]


@pytest.mark.full
def test_batches():
    compiled = model()
    found = infer_batch(
        compiled, {"y": 2e7 + np.stack([STEPS, STEPS])}, poseppl.particle_filter(compiled, 50), jax.random.key(0)
    )
    assert any("rounding decides" in text for text in provenance(found)["warnings"])


def test_the_advice_of_a_filter_that_breaks_down_fits_it():
    single, double = (SimpleNamespace(particles=np.full((5, 1), np.nan, dtype)) for dtype in (np.float32, np.float64))
    chains = SimpleNamespace(**vars(single), log_step_size=0.0)
    told = [breakdown_message(7, state, None) for state in (single, double, chains)]
    assert ["step size" in text for text in told] == [False, False, True]
    assert ["jax_enable_x64" in text for text in told] == [True, False, True]
    assert all(text.startswith("frame 7: ") and "check the model's densities)" in text for text in told)
