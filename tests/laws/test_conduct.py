"""Laws on how every filter behaves as a program: names, compilation, keys, dtypes, impossible data."""

from __future__ import annotations

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import FILTERS, rows
from law_problems import INFINITE_SQUARE, MASKED, compiled, go_through, problem

from poseppl.filters import Filter, FilterInfo

every_filter = rows(FILTERS)


@every_filter
def test_parameters_have_the_common_names_and_order(row):
    parameters = list(inspect.signature(row.function).parameters.values())
    assert parameters[0].name == "model"
    assert parameters[1].name in ("num_particles", "num_chains")
    for parameter in parameters[2:]:
        assert parameter.default is not inspect.Parameter.empty, parameter
    assert "Args:" in inspect.getdoc(row.function)
    built = row.build(problem().model)
    assert isinstance(built, Filter)
    assert list(inspect.signature(built.init).parameters) == ["rng_key", "observation", "inputs"]
    assert list(inspect.signature(built.step).parameters) == ["rng_key", "state", "observation", "inputs"]


def shapes_of(row, posed):
    """Shapes and dtypes of state and info at the first and the second frame."""
    built, key = row.build(posed.model), jax.random.key(0)
    first = jax.eval_shape(built.init, key, *posed.at(0))
    return first, jax.eval_shape(built.step, key, first[0], *posed.at(1))


@every_filter
def test_state_and_info_keep_their_shapes(row):
    posed = problem()
    first, second = shapes_of(row, posed)
    assert first == second
    state, info = first
    assert isinstance(info, FilterInfo)
    particles = jax.eval_shape(lambda state: state.particles, state)
    assert particles.shape[-1] == posed.model.dimension
    assert state.log_weights.shape == particles.shape[:-1]
    assert not any(jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) for leaf in jax.tree.leaves(state))
    assert info.ancestors.dtype == jnp.int32
    assert info.ancestors.ndim == 1
    for name in ("log_evidence", "ess", "acceptance", "divergences", "num_likelihood", "num_gradient", "failed", "step_size"):
        assert getattr(info, name).shape == (), name
    assert info.failed.dtype == bool
    assert info.divergences.dtype == jnp.int32


@every_filter
def test_compiled_once_for_a_whole_sequence(row):
    """Data, masks and inputs differ from frame to frame."""
    posed = problem()
    frames = go_through(row, posed.observations, posed.inputs)
    assert not any(info.failed for _, info in frames)
    assert len(compiled(row).traces) == 1


@every_filter
def test_info_is_within_its_range(row):
    posed = problem()
    for state, info in go_through(row, posed.observations, posed.inputs):
        assert np.isfinite(np.asarray(state.particles)).all()
        assert np.isfinite(info.log_evidence)
        assert 0 < info.ess <= state.log_weights.size * (1 + 1e-5)
        assert 0 <= info.acceptance <= 1
        assert info.divergences >= 0
        assert info.num_likelihood + info.num_gradient > 0
        assert (np.asarray(info.ancestors) >= 0).all()


EVALUATIONS = {
    "particle": (2000, 0),
    "particle-adaptive": (1000, 0),
    "particle-residual": (1000, 0),
    "particle-multinomial": (1000, 0),
    "guided": (500, 500),
    "auxiliary": (500, 500),
    "kalman": (1, 1),
    "unscented": (1, 1),
    "ensemble-kalman": (1000, 0),
    "hmc": (20, 20 * (1 + 40 * 8)),  # proposals; for each chain its start, and 40 updates of 8 leapfrog steps
    "assumed-density": (4 * (5 * 5 + 1) + 60 * 4, None),  # 4 starts try 5 damped steps 5 times; 4 candidates a chain
    "annealed": (200 * 5, 0),
    "demc": (200 * (1 + 3), 0),
    "demc-posterior": (300 * (1 + 5), 0),
}
"""Likelihoods and gradients of a frame, where they do not depend on the data; None where trajectories have random lengths."""


@pytest.mark.full
@pytest.mark.parametrize("name", EVALUATIONS)
def test_evaluations_are_counted(name):
    posed, row = problem(), next(row for row in FILTERS if row.name == name)
    likelihoods, gradients = EVALUATIONS[name]
    for _, info in go_through(row, posed.observations, posed.inputs):
        assert int(info.num_likelihood) == likelihoods
        assert gradients is None or int(info.num_gradient) == gradients


@pytest.mark.full
@pytest.mark.parametrize("name", ["particle", "particle-adaptive", "guided", "annealed", "demc"])
def test_ess_is_that_of_the_weights(name):
    posed, row = problem(), next(row for row in FILTERS if row.name == name)
    for state, info in go_through(row, posed.observations, posed.inputs):
        weights = np.exp(np.asarray(state.log_weights, float))
        np.testing.assert_allclose(info.ess, weights.sum() ** 2 / (weights**2).sum(), rtol=1e-3)


@every_filter
def test_no_key_is_used_twice(row):
    posed = problem()
    built = row.build(posed.model)
    with jax.debug_key_reuse(True):
        key_init, key_step = jax.random.split(jax.random.key(0))
        state, _ = jax.jit(built.init)(key_init, *posed.at(0))
        state, _ = jax.jit(built.step)(key_step, state, *posed.at(1))
    assert np.isfinite(np.asarray(state.particles)).all()


def test_a_key_used_twice_is_noticed():
    def careless(key):
        return jax.random.normal(key) + jax.random.normal(key)

    with jax.debug_key_reuse(True), pytest.raises(jax.errors.KeyReuseError):
        jax.jit(careless)(jax.random.key(0))


def with_impossible_frame(observations, t):
    """A value so far off that every likelihood is zero: the square of its residual overflows."""
    return observations._replace(values={"y": observations.values["y"].at[t].set(INFINITE_SQUARE)})


@every_filter
@pytest.mark.parametrize("impossible", [0, 1, 3])
def test_impossible_data_are_reported_and_survived(row, impossible):
    posed = problem()
    frames = go_through(row, with_impossible_frame(posed.observations, impossible), posed.inputs)
    assert [bool(info.failed) for _, info in frames] == [t == impossible for t in range(len(frames))]
    for t, (state, info) in enumerate(frames):
        assert np.isfinite(np.asarray(state.particles)).all()
        assert info.log_evidence == -np.inf if t == impossible else np.isfinite(info.log_evidence)


@every_filter
def test_data_that_are_not_seen_do_not_matter(row):
    """Whatever stands under the mask, the result is the same bit for bit."""
    posed = problem()
    values = posed.observations.values["y"].at[MASKED].set(77.0)
    other = posed.observations._replace(values={"y": values})
    one, two = (go_through(row, observations, posed.inputs) for observations in (posed.observations, other))
    jax.tree.map(np.testing.assert_array_equal, one, two)


@every_filter
@pytest.mark.parametrize("x64", [False, True])
def test_dtype_is_the_default_float(row, x64):
    with jax.enable_x64(x64):
        shapes = shapes_of(row, problem())
    expected = jnp.float64 if x64 else jnp.float32
    for leaf in jax.tree.leaves(shapes):
        assert not jnp.issubdtype(leaf.dtype, jnp.floating) or leaf.dtype == expected
