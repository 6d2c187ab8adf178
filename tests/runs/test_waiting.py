"""Cost of a first result and a later one beside the computation: traces, compilations, imports."""

import subprocess
import sys
import time
from collections import Counter

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr

import poseppl
from poseppl.runs import compiled_scan

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
    other = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filtered(other, build(other))  # compiles what all models share, such as constants
    filtered(model, filter)
    assert CALLS["transition"] == once > 0
    assert EVENTS[COMPILE] <= 4  # the run's keys, its start, its frames, and the key above
    filtered(model, filter, key=1)
    assert EVENTS[TRACE] == EVENTS[COMPILE] == CALLS["transition"] == 0


def test_later_results_are_one_call_for_all_frames_and_trees_without_checks(monkeypatch):
    """The calls of a later run are of the keys, the start, the frames and the smoother; xarray aligns nothing."""
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter, smoother = poseppl.kalman_filter(model), poseppl.smoothers.rauch_tung_striebel_smoother(model)

    def both(key):
        result = poseppl.infer(model, {"z": np.zeros(200)}, filter, jax.random.key(key))
        return result, poseppl.smooth(result, smoother, jax.random.key(key))

    first = both(0)
    monkeypatch.setattr(jax.stages.Compiled, "__call__", counting(jax.stages.Compiled.__call__, "compiled"))
    monkeypatch.setattr(xr.Dataset, "__init__", counting(xr.Dataset.__init__, "datasets"))
    CALLS.clear()
    again = both(0)
    assert CALLS["compiled"] == 4 and CALLS["datasets"] == 0
    for one, other in zip(first, again, strict=True):
        for group in ("posterior", "summary", "sample_stats"):
            assert one[group].identical(other[group])


def counting(function, name):
    def counted(*args, **kwargs):
        CALLS[name] += 1
        return function(*args, **kwargs)

    return counted


@pytest.mark.parametrize("build", [poseppl.kalman_filter, lambda model: poseppl.filters.ensemble_kalman_filter(model, 20)])
def test_reverse_mode_keeps_no_more_than_states_and_diagnoses(build):
    """Whatever a frame computes besides, reverse mode computes again."""
    model = poseppl.StateSpaceModel(initial, transition, seen_with_noise, parameters).compile()
    data = model.observe({"z": np.zeros(30)})

    def value(scale):
        return poseppl.log_likelihood(model, {"scale": scale}, data, build)

    def stacked(traced):
        scan = next(each for each in traced.jaxpr.eqns if each.primitive.name == "scan")
        return sum(each.aval.shape[:1] == (29,) for each in scan.outvars)  # the frames after the first

    plain, reverse = stacked(jax.make_jaxpr(value)(1.0)), stacked(jax.make_jaxpr(jax.grad(value))(1.0))
    assert reverse <= plain + 6


def parameters():
    numpyro.sample("scale", dist.LogNormal(0.0, 1.0))


def seen_with_noise(params, state, inputs):
    CALLS["seen_with_noise"] += 1
    numpyro.sample("z", dist.Normal(state["x"], params["scale"]))


def test_a_fit_compiles_few_programs_and_a_later_one_none():
    """The gradient is traced once; the other programs are of keys, of draws, of the prior and of params."""
    model = poseppl.StateSpaceModel(initial, transition, seen_with_noise, parameters).compile()
    data = np.random.default_rng(0).normal(size=20)
    EVENTS.clear(), CALLS.clear()
    jax.eval_shape(lambda: poseppl.log_likelihood(model, {"scale": 1.0}, {"z": data}, poseppl.kalman_filter))
    once = CALLS["seen_with_noise"]
    fitted = poseppl.fit(model, {"z": data}, poseppl.kalman_filter, method="map")
    assert not poseppl.findings_of_fit(fitted)
    assert CALLS["seen_with_noise"] == 2 * once > 0
    assert EVENTS[COMPILE] <= 8  # besides, what the parameters' bounds are, and the first key
    EVENTS.clear(), CALLS.clear()
    poseppl.fit(model, {"z": data + 1.0}, poseppl.kalman_filter, jax.random.key(1), method="map")
    assert EVENTS[COMPILE] == CALLS["seen_with_noise"] == 0


@pytest.mark.full
def test_programs_whose_shapes_were_stored_are_traced_one_after_the_other(monkeypatch):
    """Nothing is traced before the start and the scan are compiled, in two threads; NumPyro has one stack for both."""
    stored, inside, together = {}, [], []

    def recalled(key, name, make):
        name = name.split(",")[0]
        made = stored[name] if name in stored else make()
        return stored.setdefault(name, made) if name in ("shapes", "blank") else made

    def slowly(program):
        def traced(*arguments):
            inside.append(program)
            time.sleep(0.02)
            together.append(len(inside))
            program(*arguments)
            inside.remove(program)

        return traced

    monkeypatch.setattr(compiled_scan, "recalled", recalled)
    for programs in ((initial, transition, observation), map(slowly, (initial, transition, observation))):
        model = poseppl.StateSpaceModel(*programs).compile()
        together.clear()
        filtered(model, poseppl.particle_filter(model, 10))
    assert set(together) == {1}


def test_a_result_imports_no_statistics_and_no_figures_nor_a_track():
    code = """
import sys, jax, numpy as np, numpyro, numpyro.distributions as dist, poseppl
programs = [lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 1.0)),
            lambda params, state, inputs: numpyro.sample("x", dist.Normal(state["x"], 1.0)),
            lambda params, state, inputs: numpyro.sample("z", dist.Normal(state["x"], 1.0))]
model = poseppl.StateSpaceModel(*programs).compile()
poseppl.infer(model, {"z": np.zeros(3)}, poseppl.kalman_filter, jax.random.key(0))
print(sorted({"arviz", "arviz_stats", "scipy.stats", "scipy.optimize", "matplotlib", "plotly"} & set(sys.modules)))
import poseppl.motion.sources, poseppl.report
from poseppl.diagnostics.batches import mean_interval
mean_interval([1.0, 2.0, 3.0])
print(sorted({"arviz", "arviz_stats", "scipy.stats", "scipy.optimize", "matplotlib.pyplot"} & set(sys.modules)))
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["[]", "[]"]


def test_results_do_not_depend_on_how_many_keys_are_made_at_once(monkeypatch):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    data, filter = model.observe({"z": np.zeros(150)}), poseppl.particle_filter(model, 20)

    def particles(number):
        monkeypatch.setattr(compiled_scan, "_KEYS", number)
        monkeypatch.setattr(compiled_scan, "_key_programs", {})
        return poseppl.run_filter(filter, jax.random.key(3), data, collect=poseppl.collect_history).outputs.particles

    assert np.array_equal(particles(64), particles(512))
