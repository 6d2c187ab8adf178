"""Error messages for NumPyro users: what is wrong, what was expected, and the remedy."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro.distributions import constraints
from programs import initial, observation, transition

from poseppl.filters import kalman_filter, particle_filter
from poseppl.program import StateSpaceModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.online import Online
from poseppl.runs.run import Constant, run_filter
from poseppl.runs.smoothing import run_smoother
from poseppl.smoothers import collect_history, forward_backward_smoother

KEY = jax.random.key(0)


class Controls(NamedTuple):
    drift: Any
    scale: Any


def first(params, inputs):
    numpyro.sample("x", dist.Normal(0.0, inputs.scale))


def move(params, state, inputs):
    numpyro.sample("x", dist.Normal(state["x"] + inputs.drift @ jnp.ones(2), inputs.scale))


def see(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["x"], 1.0))


DRIVEN = StateSpaceModel(first, move, see)
FRAME = Controls(jnp.zeros(2), jnp.ones(()))
PLAIN = StateSpaceModel(initial, transition, observation).compile()
DATA = {"height": np.zeros(3)}


def scaled(params, state, inputs):
    numpyro.sample("height", dist.Normal(state["level"], params["noise"]))


@pytest.mark.parametrize(
    ("programs", "arguments", "match"),
    [
        (DRIVEN, {}, "initial program fails: AttributeError.*inputs = None.*compile\\(inputs=...\\)"),
        (
            DRIVEN,
            {"inputs": Controls(jnp.zeros((5, 3)), jnp.ones(()))},
            "transition program fails.*shapes .drift \\(5, 3\\), .scale \\(\\): expected those of one frame.*frame_inputs",
        ),
        (StateSpaceModel(initial, transition, scaled), {}, "observation program fails: TypeError.*compile\\(params=...\\)"),
    ],
    ids=["inputs forgotten", "another shape", "params omitted"],
)
def test_a_model_compiled_without_what_its_programs_read(programs, arguments, match):
    with pytest.raises(ValueError, match=match):
        programs.compile(**arguments)


def go(inputs, model, filter=particle_filter):
    return run_filter(filter(model, 4), KEY, model.observe({"y": np.zeros(5)}), inputs, collect=collect_draws(model))


@pytest.mark.parametrize("filter", [particle_filter, kalman_filter])
@pytest.mark.parametrize(
    ("inputs", "match"),
    [
        (None, "inputs of a frame are missing; the model was compiled for .drift \\(2,\\), .scale \\(\\)"),
        (Controls(jnp.zeros((5, 3)), jnp.ones(5)), "are .drift \\(3,\\), .scale \\(\\); the model"),
        (Controls(jnp.zeros((5, 2)), jnp.ones((5, 1))), "are .drift \\(2,\\), .scale \\(1,\\); the model"),
        ({"drift": jnp.zeros((5, 2)), "scale": jnp.ones(5)}, "are \\['drift'\\] \\(2,\\)"),
        (FRAME, "Constant"),
    ],
    ids=["forgotten", "another shape", "broadcastable", "another structure", "of one frame"],
)
def test_a_run_with_other_inputs_than_the_model_was_compiled_for(inputs, match, filter):
    with pytest.raises(ValueError, match=match):
        go(inputs, DRIVEN.compile(FRAME), filter)


def test_a_model_compiled_for_a_whole_sequence_of_inputs():
    """Its programs run, on states of T entries; the frames of the run give it away."""

    def scaled(params, inputs):
        numpyro.sample("x", dist.Normal(jnp.zeros(jnp.shape(inputs)), inputs))

    def moved(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"], inputs))

    model = StateSpaceModel(scaled, moved, see).compile(jnp.ones(5))
    observations = model.observe({"y": np.zeros((5, 5))})
    with pytest.raises(
        ValueError, match="are \\(\\); the model was compiled for \\(5,\\).*compile\\(\\) takes those of one frame"
    ):
        run_filter(particle_filter(model, 4), KEY, observations, jnp.ones(5), collect=collect_draws(model))


@pytest.mark.full
def test_right_inputs_are_taken():
    run = go(Controls(jnp.zeros((5, 2)), Constant(1.0)), DRIVEN.compile(FRAME))
    assert run.outputs.state.shape[0] == 5


def test_data_that_were_not_observed():
    with pytest.raises(ValueError, match="data are a dict.*model.observe\\({site: values}\\)"):
        run_filter(particle_filter(PLAIN, 4), KEY, DATA, collect=collect_draws(PLAIN))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="data are a ndarray.*model.observe"):
        Online(particle_filter(PLAIN, 4), KEY).update(np.zeros(3))  # type: ignore[arg-type]


def test_a_model_that_is_not_compiled():
    programs = StateSpaceModel(initial, transition, observation)
    with pytest.raises(AttributeError, match="before it is compiled: use model.compile\\(inputs, params\\)"):
        run_filter(particle_filter(programs, 4), KEY, PLAIN.observe(DATA), collect=collect_draws(PLAIN))  # type: ignore[arg-type]
    with pytest.raises(AttributeError, match="has no 'observe' before"):
        programs.observe(DATA)
    with pytest.raises(AttributeError, match="no attribute 'anything'"):
        programs.anything  # noqa: B018


@pytest.mark.full
def test_draws_given_as_history():
    observations = PLAIN.observe(DATA)
    run = run_filter(particle_filter(PLAIN, 4), KEY, observations, collect=collect_draws(PLAIN))
    for wrong, name in ((run.outputs, "Draws"), (run, "Run")):
        with pytest.raises(ValueError, match=f"history is a {name}.*collect=collect_history"):
            run_smoother(forward_backward_smoother(PLAIN), KEY, wrong, observations, collect=collect_draws(PLAIN))
    right = run_filter(particle_filter(PLAIN, 4), KEY, observations, collect=collect_history).outputs
    run_smoother(forward_backward_smoother(PLAIN), KEY, right, observations, collect=collect_draws(PLAIN))


def improper(*arguments):
    numpyro.sample("level", dist.ImproperUniform(constraints.real, (), ()))
    numpyro.sample("slope", dist.Normal(0.0, 1.0).expand([2]))


def with_own_key(params, state, inputs):
    jitter = jax.random.normal(numpyro.prng_key())
    numpyro.sample("level", dist.Normal(state["level"] + jitter, 0.5))
    numpyro.sample("slope", dist.Normal(state["slope"], 0.5))


def subsampled(params, state, inputs):
    with numpyro.plate("sensors", 2, subsample_size=1) as seen:
        numpyro.sample("reading", dist.Normal(state["slope"][seen], 0.5))


@pytest.mark.full
def test_draws_without_a_density_and_densities_without_draws():
    with pytest.raises(ValueError, match="initial program samples 'level' from ImproperUniform.*wide Normal"):
        StateSpaceModel(improper, transition, observation).compile()
    with pytest.raises(ValueError, match="transition program samples 'level' from ImproperUniform"):
        StateSpaceModel(initial, improper, observation).compile()
    with pytest.raises(ValueError, match="transition program asks for numpyro.prng_key\\(\\).*numpyro.sample"):
        StateSpaceModel(initial, with_own_key, observation).compile()
    with pytest.raises(ValueError, match="observation program draws a subsample in the plate 'sensors'.*NaN"):
        StateSpaceModel(initial, transition, subsampled).compile()


@pytest.mark.full
@pytest.mark.parametrize("noise", [1e-3, 1.0])
@pytest.mark.parametrize("told_by", ["program", "params", "inputs"])
def test_data_that_float32_rounds_by_more_than_their_noise(caplog, noise, told_by):
    def observed(params, state, inputs):
        scale = {"program": noise, "params": params, "inputs": inputs}[told_by]
        numpyro.sample("height", dist.Normal(state["level"], scale))
        numpyro.sample("pair", dist.MultivariateNormal(jnp.zeros(2), jnp.eye(2)))

    model = StateSpaceModel(initial, transition, observed).compile(inputs=1.0, params=noise)
    for _ in range(2):
        model.observe({"height": [1e5, np.nan], "pair": np.full((2, 2), 3.0)})
    wanted = noise == 1e-3 and told_by != "inputs"
    assert len(caplog.messages) == wanted
    assert (
        not wanted or "'height': numbers as large as 1e+05 are 0.0078 apart in float32, and the noise is 0.001" in caplog.text
    )
