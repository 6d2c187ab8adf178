"""One call from model and data to a result, and from a result to its smoothing."""

from __future__ import annotations

import logging
import subprocess
import sys
from functools import partial

import arviz_stats
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from law_problems import problem

import poseppl
from poseppl.checks import check_key
from poseppl.diagnostics.replicates import NONE, WEIGHTS, evidence_of_run
from poseppl.diagnostics.run_figures import FORMULA, kind_of_run
from poseppl.errors import InputError
from poseppl.filters import Filter, annealed_filter
from poseppl.runs import recompilation
from poseppl.smoothers import Smoother, genealogy_smoother, pmmh, rauch_tung_striebel_smoother
from poseppl.smoothers.static_parameters import particle_gibbs

POSED = problem()
KEY = jax.random.key(0)
VALUES = {"y": np.where(POSED.observations.mask["y"], POSED.observations.values["y"], np.nan)}


def filtered(**options):
    return poseppl.infer(POSED.model, VALUES, poseppl.particle_filter(POSED.model, 300), KEY, inputs=POSED.inputs, **options)


@pytest.mark.full
def test_a_dict_of_arrays_gives_what_the_long_form_gives():
    result = filtered(truth=POSED.exact.means, rate=25.0, frames=range(10, 15), attrs={"model": "toy"})
    collect = poseppl.collect_draws(POSED.model)
    run = poseppl.run_filter(poseppl.particle_filter(POSED.model, 300), KEY, POSED.observations, POSED.inputs, collect=collect)
    about = {"truth": POSED.exact.means, "rate": 25.0, "frames": range(10, 15), "attrs": {"model": "toy"}}
    long = poseppl.result_of_run(run, POSED.model, POSED.observations, **about)
    for name in ("posterior", "summary", "sample_stats", "observed_data", "truth"):
        xr.testing.assert_identical(result[name].to_dataset(), long[name].to_dataset())
    assert set(result.attrs) == set(long.attrs)
    assert arviz_stats.ess(result["posterior"])["x"].shape == (5, 2)


def test_what_was_not_checked_is_said():
    unseen = {"y": np.full_like(VALUES["y"], np.nan)}
    filter = poseppl.particle_filter(POSED.model, 300)
    texts = [
        [found.text for found in poseppl.verdicts(poseppl.infer(POSED.model, data, filter, KEY, POSED.inputs, predict=checks))]
        for data, checks in ((VALUES, None), (VALUES, poseppl.predictive_checks(POSED.model)), (unseen, None))
    ]
    assert [any("were not checked. To check them: infer(..., predict=" in text for text in told) for told in texts] == [
        True,
        False,
        True,
    ]
    nothing = "Nothing was observed in any frame: the posterior is the prior."
    assert [nothing in told for told in texts] == [False, False, True]


@pytest.mark.parametrize("seed", [0, None, np.int64(3), "key"])
def test_a_seed_is_no_key(seed):
    with pytest.raises(ValueError, match="rng_key is .* Expected a key, such as jax.random.key"):
        poseppl.infer(POSED.model, VALUES, poseppl.particle_filter(POSED.model, 300), seed, POSED.inputs)


@pytest.mark.parametrize(
    "call",
    [
        lambda seed: poseppl.simulate(POSED.model, seed, 5, POSED.inputs),
        lambda seed: poseppl.infer_batch(POSED.model, [VALUES], poseppl.kalman_filter, seed, [POSED.inputs]),
        lambda seed: poseppl.forecast(filtered(), POSED.model, 5, seed, POSED.inputs),
        lambda seed: poseppl.hindcast(filtered(), POSED.model, 2, seed, POSED.inputs),
        lambda seed: poseppl.add_predictive(filtered(), POSED.model, seed, POSED.inputs),
        lambda seed: poseppl.smooth(filtered(), rauch_tung_striebel_smoother(POSED.model), seed, POSED.inputs),
        lambda seed: poseppl.calibrate(POSED.model, poseppl.kalman_filter, seed, num_frames=5, inputs=POSED.inputs),
        lambda seed: poseppl.calibrate_parameters(POSED.model, lambda key, data: {}, seed, num_frames=5, inputs=POSED.inputs),
        lambda seed: poseppl.log_likelihood(POSED.model, None, VALUES, poseppl.kalman_filter, seed, POSED.inputs),
        lambda seed: pmmh(POSED.model, seed, POSED.observations, POSED.inputs, build_filter=poseppl.kalman_filter),
        lambda seed: particle_gibbs(POSED.model, seed, POSED.observations, POSED.inputs),
    ],
)
def test_a_seed_is_no_key_anywhere(call):
    with pytest.raises(ValueError, match="rng_key is 7. Expected a key, such as jax.random.key"):
        call(7)


def test_keys_of_both_kinds_are_taken():
    check_key(KEY)
    check_key(jax.random.PRNGKey(0))


@pytest.mark.full
@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"truth": np.zeros(5)}, r"truth: an array of shape \(5,\) .expected \(5, 2\), .*coordinates x\[0\], x\[1\]"),
        ({"truth": {"x": np.zeros((5, 2))}}, "truth: an array of shape"),
        ({"frames": range(4)}, "frames: 4 numbers from 0 to 3 .expected 5 whole numbers that increase"),
        ({"frames": [0, 1, 1, 2, 3]}, "frames: .*expected 5 whole numbers that increase"),
        ({"frames": np.arange(5) / 2}, "frames: .*expected 5 whole numbers"),
        ({"frames": np.arange(5).astype("M8[D]")}, r"frames: datetime64\[D\] of shape \(5,\) .expected 5 whole numbers"),
    ],
)
def test_labels_that_do_not_fit_are_refused_before_the_run(options, match):
    with pytest.raises(InputError, match=match):
        filtered(**options)


@pytest.mark.full
@pytest.mark.parametrize("filter", [poseppl.kalman_filter, partial(poseppl.kalman_filter, num_particles=1000)])
def test_a_builder_stands_for_its_filter(filter):
    built, handed = (
        poseppl.infer(POSED.model, data, given, KEY, POSED.inputs)
        for data, given in ((VALUES, poseppl.kalman_filter(POSED.model)), (POSED.observations, filter))
    )
    xr.testing.assert_identical(built["posterior"].to_dataset(), handed["posterior"].to_dataset())


@pytest.mark.full
def test_a_result_is_smoothed():
    result = filtered(truth=POSED.exact.means, rate=25.0, attrs={"model": "toy"})
    smoother = poseppl.backward_simulation_smoother(POSED.model, 1000)
    smoothed = poseppl.smooth(result, smoother, KEY, inputs=POSED.inputs, attrs={"seed": 3})
    xr.testing.assert_identical(smoothed["observed_data"].to_dataset(), result["observed_data"].to_dataset())
    xr.testing.assert_identical(smoothed["truth"].to_dataset(), result["truth"].to_dataset())
    known = poseppl.runs.results.provenance(smoothed)
    assert (known["model"], known["seed"], known["smoother"]) == ("toy", 3, "backward_simulation_smoother")
    assert smoothed.attrs["rate"] == 25.0
    assert smoothed["sample_stats/log_evidence"].equals(result["sample_stats/log_evidence"])
    assert smoothed["unconstrained_posterior/state"].shape == (1, 200, 5, 2)
    # the future moves the first frame; nothing moves the last
    apart = abs(smoothed["summary/state_mean"] - result["summary/state_mean"]).max("state_dim").values
    assert apart[0] > 2 * apart[-1]
    with pytest.raises(ValueError, match="smoothed already"):
        poseppl.smooth(smoothed, smoother, KEY, inputs=POSED.inputs)


@pytest.mark.full
def test_results_say_of_what_kind_their_algorithm_is():
    """A formula's evidence has no Monte Carlo error: it is the same for every key, and no other filter's is."""
    sources = {}
    for build in (
        poseppl.kalman_filter,
        partial(poseppl.particle_filter, num_particles=300),
        partial(annealed_filter, num_particles=50),
    ):
        first, second = (poseppl.infer(POSED.model, VALUES, build, jax.random.key(seed), POSED.inputs) for seed in (0, 1))
        found = evidence_of_run(first)
        sources[found.source] = known = poseppl.runs.results.provenance(first)
        same = first["sample_stats/log_evidence"].equals(second["sample_stats/log_evidence"])
        assert same == known["closed form"] == (found.standard_error == 0.0)
        assert same == first["summary"].equals(second["summary"])
    assert list(sources) == [FORMULA, WEIGHTS, NONE]
    smoothed = poseppl.smooth(first, rauch_tung_striebel_smoother(POSED.model), KEY, inputs=POSED.inputs)
    assert kind_of_run(smoothed) == FORMULA != kind_of_run(first)


@pytest.mark.full
def test_all_particles_are_smoothed_from_a_history():
    run = poseppl.run_filter(
        poseppl.particle_filter(POSED.model, 300), KEY, POSED.observations, POSED.inputs, collect=poseppl.collect_history
    )
    smoothed = poseppl.smooth(run.outputs, genealogy_smoother(POSED.model), KEY, POSED.inputs, data=VALUES)
    assert smoothed.attrs["num_particles"] == 300
    with pytest.raises(ValueError, match="data=data"):
        poseppl.smooth(run.outputs, genealogy_smoother(POSED.model), KEY, POSED.inputs)


@pytest.mark.full
def test_what_is_no_model_filter_smoother_or_result_is_said():
    other = problem().model
    with pytest.raises(ValueError, match="not compiled"):
        poseppl.infer(POSED.model.programs, VALUES, poseppl.kalman_filter, KEY)
    with pytest.raises(ValueError, match="another model"):
        poseppl.infer(POSED.model, VALUES, poseppl.particle_filter(other, 10), KEY, POSED.inputs)
    with pytest.raises(ValueError, match="The filter is a int"):
        poseppl.infer(POSED.model, VALUES, 7, KEY)
    with pytest.raises(ValueError, match="no observation site"):
        poseppl.infer(POSED.model, {"z": VALUES["y"]}, poseppl.kalman_filter, KEY)
    with pytest.raises(ValueError, match="Expected draws"):
        filtered(collect=lambda rng_key, state, info, inputs: state.particles)
    with pytest.raises(ValueError, match="does not know its model"):
        poseppl.smooth(filtered(), Smoother(genealogy_smoother(POSED.model).smooth, True), KEY)
    with pytest.raises(ValueError, match="of the filter is a Problem"):
        poseppl.smooth(POSED, genealogy_smoother(POSED.model), KEY)
    with pytest.raises(ValueError, match="no ancestor"):
        poseppl.smooth(filtered(history_mib=0), genealogy_smoother(POSED.model), KEY, POSED.inputs)


def run_with(collect, filter=None):
    filter = poseppl.particle_filter(POSED.model, 20) if filter is None else filter
    return poseppl.run_filter(filter, KEY, POSED.observations, POSED.inputs, collect=collect)


@pytest.mark.full
def test_a_lambda_in_a_loop_is_said_once(caplog):
    shared = jnp.ones(2)
    with caplog.at_level(logging.WARNING, logger="poseppl"):
        for _ in range(3):
            run_with(lambda rng_key, state, info, inputs: state.particles @ shared)
    assert len(caplog.messages) == 1
    assert "collector" in caplog.messages[0] and "test_infer.py" in caplog.messages[0]


@pytest.mark.full
def test_other_collectors_and_the_same_are_not_said(caplog):
    def times(factor):
        return lambda rng_key, state, info, inputs: factor * state.particles

    twice = times(2.0)
    with caplog.at_level(logging.WARNING, logger="poseppl"):
        for collect in (twice, times(3.0), twice):
            run_with(collect)
        for count in range(12, 12 + 40):  # more than are kept
            poseppl.collect_draws(POSED.model, max_draws=count)
    assert not caplog.messages


@pytest.mark.full
def test_a_filter_written_by_hand_in_a_loop_is_said_once(caplog):
    inner = poseppl.particle_filter(POSED.model, 10)
    recompilation._told.clear()

    def build():
        return Filter(lambda *frame: inner.init(*frame), lambda *frame: inner.step(*frame))

    with caplog.at_level(logging.WARNING, logger="poseppl"):
        for _ in range(3):
            run_with(poseppl.collect_history, build())
    assert len(caplog.messages) == 1 and "filter" in caplog.messages[0]


FIRST_RESULT = """
import sys
import jax, numpy as np
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
import poseppl
jax.config.update("jax_enable_compilation_cache", False)
key, compiled = jax.random.key(0), []
def tell(name, seconds, fun_name="", **told):
    if name.endswith("backend_compile_duration"):
        compiled.append(fun_name)
jax.monitoring.register_event_duration_secs_listener(tell)
model = linear_gaussian_model(linear_gaussian_matrices(1)).compile()
poseppl.infer(model, {"y": np.zeros((3, 1))}, poseppl.particle_filter(model, 100), key)
print(*compiled)
compiled.clear()
poseppl.infer(model, {"y": np.zeros((3, 1))}, poseppl.kalman_filter(model, 100), key)
print(*compiled)
"""


@pytest.mark.full
def test_a_first_result_compiles_the_programs_of_the_run_and_few_others():
    """A small one takes a hundredth of what the run's take; data and levels that jnp.asarray made would each need one.

    That of the frames' keys serves all filters: a second one compiles its own two alone.
    """
    done = subprocess.run([sys.executable, "-c", FIRST_RESULT], check=True, capture_output=True, text=True)
    compiled, of_second = (line.split() for line in done.stdout.splitlines())
    assert {"jit(_key_data)", "jit(start)", "jit(scan_frames)"} <= set(compiled)
    assert len(compiled) <= 5, compiled
    assert set(of_second) == {"jit(start)", "jit(scan_frames)"}
