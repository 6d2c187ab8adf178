"""What a first result and a later one cost beside the numbers: traces, compilations, imports."""

import subprocess
import sys
from collections import Counter

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl

TRACE, COMPILE = "/jax/core/compile/jaxpr_trace_duration", "/jax/core/compile/backend_compile_duration"
EVENTS: Counter = Counter()
jax.monitoring.register_event_duration_secs_listener(lambda event, seconds, **_: EVENTS.update([event]))
CALLS: Counter = Counter()


def initial(params, inputs):
    CALLS["initial"] += 1
    numpyro.sample("x", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    CALLS["transition"] += 1
    numpyro.sample("x", dist.Normal(0.9 * state["x"], 1.0))


def observation(params, state, inputs):
    CALLS["observation"] += 1
    numpyro.sample("z", dist.Normal(state["x"], 1.0))


def filtered(model, filter, key=0):
    EVENTS.clear(), CALLS.clear()
    return poseppl.infer(model, {"z": np.zeros(20)}, filter, jax.random.key(key))


@pytest.mark.parametrize("build", [poseppl.particle_filter, poseppl.kalman_filter])
def test_a_run_traces_each_program_once_and_a_later_one_none(build):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter = build(model)
    data = jax.tree.map(lambda leaf: leaf[0], model.observe({"z": np.zeros(20)}))
    state = jax.eval_shape(filter.init, jax.random.key(0), data)[0]
    CALLS.clear()
    jax.eval_shape(filter.step, jax.random.key(0), state, data)
    once = CALLS["transition"]
    filtered(model, filter)
    assert CALLS["transition"] == once > 0
    assert EVENTS[COMPILE] <= 4  # the run's keys, its start, its frames, and the key above
    filtered(model, filter, key=1)
    assert EVENTS[TRACE] == EVENTS[COMPILE] == CALLS["transition"] == 0


def test_a_result_imports_no_statistics_and_no_figures():
    code = """
import sys, jax, numpy as np, numpyro, numpyro.distributions as dist, poseppl
programs = [lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 1.0)),
            lambda params, state, inputs: numpyro.sample("x", dist.Normal(state["x"], 1.0)),
            lambda params, state, inputs: numpyro.sample("z", dist.Normal(state["x"], 1.0))]
model = poseppl.StateSpaceModel(*programs).compile()
poseppl.infer(model, {"z": np.zeros(3)}, poseppl.kalman_filter, jax.random.key(0))
print(sorted({"arviz", "arviz_stats", "scipy.stats", "scipy.optimize", "matplotlib", "plotly"} & set(sys.modules)))
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
