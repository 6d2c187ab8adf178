"""Laws on models of another kind: counts of a positive rate, a chain of sites, and a state of which a part is known."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from catalogue import FILTERS
from law_problems import replicate, z_scores
from other_problems import clamped, counted, moving

from poseppl import StateSpaceModel, infer, particle_filter

ROWS = {row.name: row for row in FILTERS}
REPLICATES = 40


def check(row, posed, *, evidence=True):
    means, seconds, increments = replicate(row.build(posed.model), posed, REPLICATES)
    assert np.abs(z_scores(means, posed.exact.means)).max() < 5
    assert np.abs(z_scores(seconds, posed.exact.covariances)).max() < 5
    if evidence:
        ratios = np.exp(increments - posed.exact.log_evidence)
        assert (np.abs(ratios.mean(0) - 1) < 5 * ratios.std(0, ddof=1) / np.sqrt(REPLICATES) + 1e-4).all()


@pytest.mark.full
@pytest.mark.parametrize(
    "name",
    ["particle", "auxiliary", *(pytest.param(name, marks=pytest.mark.slow) for name in ("tempered", "demc-posterior"))],
)
def test_counts_of_a_positive_rate(name):
    check(ROWS[name], counted())


@pytest.mark.full
@pytest.mark.parametrize(
    "name",
    [
        "particle",
        "auxiliary",
        "kalman",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("assumed-density", "window", "tempered")),
    ],
)
def test_a_part_of_the_state_that_is_known(name):
    """The evidence, too, is that of the data alone, given what is known."""
    check(ROWS[name], clamped())


@pytest.mark.full
@pytest.mark.parametrize(
    "name", ["kalman", "guided", *(pytest.param(name, marks=pytest.mark.slow) for name in ("assumed-density", "auxiliary"))]
)
def test_a_position_that_depends_on_the_velocity_of_its_frame(name):
    check(ROWS[name], moving())


def means_of_counts(ys, slope):
    """Exact means of a state of counts, each Poisson of rate 1 + slope times the last, seen with a unit error."""
    counts = np.arange(60)
    step = scipy.stats.poisson.pmf(counts[None], 1.0 + slope * counts[:, None])
    weights, means = scipy.stats.poisson.pmf(counts, 3.0), []
    for t, y in enumerate(ys):
        weights = (weights if t == 0 else weights @ step) * scipy.stats.norm.pdf(y, counts, 1.0)
        weights = weights / weights.sum()
        means.append(weights @ counts)
    return np.array(means)


@pytest.mark.full
def test_a_state_of_counts():
    """Against all counts up to 59; another rate is noticed."""

    def transition(params, state, inputs):
        numpyro.sample("count", dist.Poisson(1.0 + 0.5 * state["count"]))

    program = StateSpaceModel(
        lambda params, inputs: numpyro.sample("count", dist.Poisson(3.0)),
        transition,
        lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["count"], 1.0)),
    )
    model, ys = program.compile(), [2.0, 6.0, 1.0]
    build = particle_filter(model, 2000)
    runs = [infer(model, {"y": ys}, build, jax.random.key(seed))["summary/state_mean"].values[:, 0] for seed in range(20)]
    assert np.abs(z_scores(np.array(runs), means_of_counts(ys, 0.5))).max() < 5
    assert np.abs(z_scores(np.array(runs), means_of_counts(ys, 0.6))).max() > 10


@pytest.mark.full
def test_known_values_of_the_wrong_frame_are_noticed():
    posed = clamped()
    late = posed._replace(inputs=jax.tree.map(lambda leaf: jnp.roll(leaf, 1, axis=0), posed.inputs))
    means, _, _ = replicate(ROWS["particle"].build(posed.model), late, REPLICATES)
    assert np.abs(z_scores(means, posed.exact.means)).max() > 20
