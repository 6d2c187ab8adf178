"""Laws on builders: equal settings for the same model give the same object, so that nothing is compiled again."""

from __future__ import annotations

import gc
import weakref

import jax
import pytest
from catalogue import FILTERS, SMOOTHERS, is_first, rows
from law_problems import problem

from poseppl.filters import particle_filter, sharded
from poseppl.runs.collectors import collect_draws
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.run import run_filter

POSED = problem()
KEY = jax.random.key(0)


def live_executables() -> int:
    gc.collect()
    return len(jax.local_devices()[0].client.live_executables())


@rows([*FILTERS, *SMOOTHERS], is_first)
def test_equal_settings_give_the_same_object_which_knows_its_model(row):
    built = row.build(POSED.model)
    assert row.build(POSED.model) is built
    assert built.model is POSED.model
    other = problem().model
    assert row.build(other) is not built and row.build(other).model is other


@rows(FILTERS, is_first)
def test_what_jax_traces_is_built_again(row):
    """An object that is built while a function is traced may contain tracers, and must not be reused."""
    model, built = problem().model, []
    jax.make_jaxpr(lambda x: built.append(row.build(model)) or x)(1.0)
    assert row.build(model) is not built[0]


@pytest.mark.full
def test_twenty_equal_filters_and_collectors_compile_once():
    builders = [
        lambda: particle_filter(POSED.model, 37),
        lambda: particle_filter(POSED.model, num_particles=37, resampling="systematic"),
    ]

    def go(turn):
        collect, predict = collect_draws(POSED.model, max_draws=7), predictive_checks(POSED.model, 8)
        filter = builders[turn % 2]()
        run_filter(filter, KEY, POSED.observations, POSED.inputs, collect=collect, predict=predict, chunk=1 + turn)
        return live_executables()

    first, *others = (go(turn) for turn in range(20))
    assert others == [first] * 19


@pytest.mark.full
def test_what_was_compiled_goes_with_the_model():
    def go():
        posed = problem()
        filter = particle_filter(posed.model, 37)
        run_filter(filter, KEY, posed.observations, posed.inputs, collect=collect_draws(posed.model))
        return weakref.ref(posed.model)

    go()
    before = live_executables()
    model = go()
    assert live_executables() <= before and model() is None


def test_other_settings_give_another_object():
    one = particle_filter(POSED.model, 37)
    others = [
        particle_filter(POSED.model, 38),
        particle_filter(POSED.model, 37, resampling="stratified"),
        particle_filter(POSED.model, 37, ess_threshold=1),  # an integer: not what 1.0 is
        sharded(one, 1),
    ]
    assert len({id(filter) for filter in (one, *others)}) == 5
    assert sharded(one, 1) is others[-1] and others[-1].model is POSED.model
    with jax.enable_x64(True):
        assert particle_filter(POSED.model, 37) is not one
    assert particle_filter(POSED.model, 37) is one
