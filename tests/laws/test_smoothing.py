"""Laws on every smoother: how it behaves as a program."""

from __future__ import annotations

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import SMOOTHERS, rows
from smoothing_problems import history_for_conduct, linear_problem, smoother_for_conduct

from poseppl.smoothers import Smoother, SmoothingInfo

every_smoother = rows(SMOOTHERS)


@every_smoother
def test_parameters_have_the_common_names_and_order(row):
    parameters = list(inspect.signature(row.function).parameters.values())
    assert parameters[0].name == "model"
    for parameter in parameters[1:]:
        positional = parameter.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
        assert parameter.default is not inspect.Parameter.empty or parameter.name.startswith("num_"), parameter
        assert not positional or parameter.name.startswith("num_"), parameter
    assert "Args:" in inspect.getdoc(row.function)
    built = row.build(linear_problem().model)
    assert isinstance(built, Smoother)
    assert list(inspect.signature(built.smooth).parameters) == ["rng_key", "history", "observations", "inputs"]


@every_smoother
@pytest.mark.parametrize("x64", [False, True])
def test_result_has_the_common_form(row, x64):
    with jax.enable_x64(x64):
        dtype = jnp.float64 if x64 else jnp.float32
        posed = linear_problem()

        def as_default(leaf):
            return jnp.asarray(leaf, dtype) if jnp.issubdtype(leaf.dtype, jnp.floating) else jnp.asarray(leaf)

        history, observations, inputs = jax.tree.map(as_default, history_for_conduct())
        smoothed = jax.eval_shape(row.build(posed.model).smooth, jax.random.key(0), history, observations, inputs)
    assert smoothed.particles.shape[0] == 5
    assert smoothed.particles.shape[-1] == posed.model.dimension
    assert smoothed.particles.ndim in (3, 4)
    assert smoothed.log_weights.shape == smoothed.particles.shape[:-1]
    assert isinstance(smoothed.info, SmoothingInfo)
    assert smoothed.info.ess.shape == smoothed.info.acceptance.shape == (5,)
    assert smoothed.info.divergences.dtype == jnp.int32
    for leaf in jax.tree.leaves(smoothed):
        assert not jnp.issubdtype(leaf.dtype, jnp.floating) or leaf.dtype == dtype


def check_usable(smoothed):
    for leaf in jax.tree.leaves(smoothed):
        assert not np.isnan(np.asarray(leaf)).any()
    assert np.isfinite(np.asarray(smoothed.particles)).all()
    log_weights = np.asarray(smoothed.log_weights, float).reshape(len(smoothed.log_weights), -1)
    if smoothed.particles.ndim == 3:
        np.testing.assert_allclose(np.exp(log_weights).sum(1), 1.0, rtol=1e-4)
    else:
        np.testing.assert_array_equal(log_weights, 0.0)
    info = smoothed.info
    assert (np.asarray(info.ess) > 0).all()
    assert (np.asarray(info.ess) <= log_weights.shape[1] * (1 + 1e-4)).all()
    assert ((np.asarray(info.acceptance) >= 0) & (np.asarray(info.acceptance) <= 1)).all()
    assert info.divergences >= 0


@every_smoother
def test_no_key_is_used_twice(row):
    with jax.debug_key_reuse(True):
        smoothed = smoother_for_conduct(row)[0](jax.random.key(0), *history_for_conduct())
    check_usable(smoothed)


@every_smoother
def test_compiled_once_for_data_of_one_length(row):
    """Also survives a frame of impossible data, which the filter has reported, and particles that are all one."""
    smooth, traces = smoother_for_conduct(row)
    check_usable(smooth(jax.random.key(0), *history_for_conduct()))
    before = len(traces)
    for impossible in (0, 1, 4):
        history, observations, inputs = history_for_conduct(impossible=impossible)
        assert [bool(failed) for failed in history.failed] == [t == impossible for t in range(5)]
        check_usable(smooth(jax.random.key(1), history, observations, inputs))
    history, observations, inputs = history_for_conduct()
    equal = history._replace(particles=jnp.broadcast_to(history.particles[:1, :1], history.particles.shape))
    check_usable(smooth(jax.random.key(2), equal, observations, inputs))
    assert len(traces) == before


@every_smoother
def test_data_that_are_not_seen_do_not_matter(row):
    history, observations, inputs = history_for_conduct()
    other = observations._replace(values={"y": observations.values["y"].at[2].set(77.0)})
    smooth = smoother_for_conduct(row)[0]
    one, two = (smooth(jax.random.key(0), history, data, inputs) for data in (observations, other))
    jax.tree.map(np.testing.assert_array_equal, one, two)


@pytest.mark.full
@every_smoother
@pytest.mark.parametrize(("num_particles", "num_frames"), [(20, 1), (1, 3)])
def test_one_frame_and_one_particle(row, num_particles, num_frames):
    built = row.build(linear_problem().model)
    check_usable(jax.jit(built.smooth)(jax.random.key(0), *history_for_conduct(num_particles, num_frames)))


@every_smoother
def test_another_key_makes_other_draws(row):
    """In every frame: other states, or other weights; or, of a smoother that draws nothing, none."""
    smooth = smoother_for_conduct(row)[0]
    one, two = (smooth(jax.random.key(seed), *history_for_conduct()) for seed in (0, 1))
    differ = (np.asarray(one.particles) != np.asarray(two.particles)).any(-1) | np.asarray(one.log_weights != two.log_weights)
    changed = differ.reshape(len(differ), -1).any(1)
    assert changed.all() if row.draws else not changed.any()
