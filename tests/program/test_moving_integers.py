"""Integers whose bounds are a state, as of chain binomials: filters and smoothers against sums over all values."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats

import poseppl
from poseppl.program import StateSpaceModel
from poseppl.smoothers import forward_backward_smoother

MOST, FRAMES = 10, 6
DATA = np.array([7.0, 6.4, np.nan, 5.1, 2.0, 2.2])
COUNTS = np.arange(MOST + 1)
LAWS = {
    "binomial": (lambda left: dist.Binomial(left, 0.8), lambda n: stats.binom.pmf(COUNTS, n, 0.8)),
    "uniform": (lambda left: dist.DiscreteUniform(0, left), lambda n: (n >= COUNTS) / (n + 1)),
}


def exact_means(row):
    """Filtered and smoothed means (T,) and the log-evidence."""
    first, moves = stats.binom.pmf(COUNTS, MOST, 0.7), np.array([row(n) for n in COUNTS])
    likelihood = np.where(np.isnan(DATA)[:, None], 1.0, stats.norm.pdf(np.nan_to_num(DATA)[:, None], COUNTS, 1.0))
    forward, backward = [first * likelihood[0]], [np.ones(MOST + 1)]
    for t in range(1, FRAMES):
        forward.append(forward[-1] @ moves * likelihood[t])
        backward.append(moves @ (likelihood[-t] * backward[-1]))
    told = [np.array(forward), np.array(forward) * np.array(backward[::-1])]
    return *(joint @ COUNTS / joint.sum(1) for joint in told), np.log(forward[-1].sum())


def model_of(law):
    def initial(params, inputs):
        numpyro.sample("left", dist.Binomial(MOST, 0.7))

    def transition(params, state, inputs):
        numpyro.sample("left", law(state["left"]))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["left"], 1.0))

    return StateSpaceModel(initial, transition, observation).compile()


@pytest.mark.full
@pytest.mark.parametrize("name", LAWS)
def test_what_is_left_of_a_count_is_what_sums_over_all_counts_give(name):
    law, row = LAWS[name]
    model = model_of(law)
    filtered, smoothed_means, log_evidence = exact_means(row)
    found = poseppl.infer(model, {"y": DATA}, poseppl.particle_filter(model, 20_000), jax.random.key(0))
    # 20,000 particles: means err by 0.01, the evidence by 0.01
    np.testing.assert_allclose(found["summary/left_mean"], filtered, atol=0.06)
    assert float(found["sample_stats/log_evidence"].sum()) == pytest.approx(log_evidence, abs=0.06)
    few = poseppl.infer(model, {"y": DATA}, poseppl.particle_filter(model, 2000), jax.random.key(1))
    smoothed = poseppl.smooth(few, forward_backward_smoother(model), jax.random.key(2))
    np.testing.assert_allclose(smoothed["summary/left_mean"], smoothed_means, atol=0.2)


@pytest.mark.parametrize("name", LAWS)
def test_more_than_there_was_is_impossible(name):
    model = model_of(LAWS[name][0])
    with numpyro.validation_enabled(False):
        log = [float(model.log_transition(jnp.array([n]), jnp.array([4.0]))) for n in range(7)]
    np.testing.assert_array_equal(np.isfinite(log), np.arange(7) <= 4)
    assert model.finite_values == {} and model.finite_sites == ("left",)


@pytest.mark.full
@pytest.mark.parametrize(
    ("first", "later", "taken"),
    [
        (dist.Binomial(MOST, 0.7), dist.Poisson(3.0), True),
        (dist.Poisson(3.0), dist.Binomial(MOST, 0.7), True),
        (dist.Poisson(3.0), dist.Poisson(4.0), True),
        (dist.Categorical(jnp.ones(2) / 2), dist.Categorical(jnp.ones(3) / 3), False),
    ],
)
def test_counts_may_have_other_bounds_in_the_first_frame_but_other_categories_are_a_mistake(first, later, taken):
    programs = StateSpaceModel(
        lambda params, inputs: numpyro.sample("n", first),
        lambda params, state, inputs: numpyro.sample("n", later),
        lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["n"], 1.0)),
    )
    if taken:
        assert programs.compile().finite_sites == ("n",)
    else:
        with pytest.raises(ValueError, match="Expected equal supports"):
            programs.compile()
