"""The programs of a learned activity under filters, against every sequence of phases with a Kalman filter for each."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import Problem, replicate, run, z_scores
from oracles.switching import switching_filter
from poseppl_models.bodies.learned_motion import Activity, learned_motion

from poseppl.errors import UnsuitableModelError
from poseppl.filters import annealed_filter, guided_filter, particle_filter, tempered_filter
from poseppl.kernels import RANDOM_WALK_MOVES
from poseppl.program import StateSpaceModel

COORDINATES = (("hip", "tx"), ("knee", "X"), ("ankle", "X"))
LEARNED = (1, 2)
ACTIVITY = Activity(
    initial=jnp.array([0.3, 0.7]),
    transition=jnp.array([[0.6, 0.4], [0.25, 0.75]]),
    means=jnp.array([[-1.0], [0.8]]),
    scales=jnp.array([[[0.4]], [[0.7]]]),
    centre=jnp.array([0.2, -0.1]),
    components=jnp.array([[0.6], [0.8]]),
    residual_scale=jnp.array([0.3, 0.2]),
    residual_kept=jnp.array([0.9, 0.5]),
)
START, START_SCALE, STEP = 0.5, 0.6, 0.4
READING = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -0.5]])
NOISE = 0.3
DATA = np.array([[0.2, 0.4], [1.0, 0.1], [np.nan, np.nan], [0.3, -0.6]])


class Inputs(NamedTuple):
    activity: Any
    start: Any
    start_scale: Any
    step_scale: Any


def read_pose(params, pose, inputs):
    numpyro.sample("y", dist.Normal(jnp.asarray(READING) @ pose, NOISE).to_event(1))


INPUTS = Inputs(ACTIVITY, *(jnp.full(3, value) for value in (START, START_SCALE, STEP)))


def posed(residual):
    """The problem with its exact answer; the state is (phase, features, hip.tx, residual of two)."""
    model = learned_motion(COORDINATES, LEARNED, read_pose, residual=residual).compile(INPUTS)
    a = jax.tree.map(lambda leaf: np.asarray(leaf, float), ACTIVITY)
    size = 4 if residual else 2
    kept = np.diag(np.concatenate([[0.0, 1.0], a.residual_kept])[:size])
    pose = np.zeros((3, size))
    pose[1:, 0], pose[0, 1] = a.components[:, 0], 1.0
    pose[1:, 2:] = np.eye(2)[:, : size - 2]

    def first(k):
        spread = np.array([a.scales[k, 0, 0], START_SCALE, *a.residual_scale])[:size]
        return np.array([a.means[k, 0], START, 0.0, 0.0])[:size], np.diag(spread**2)

    def later(_, k):
        left = a.residual_scale * np.sqrt(1 - a.residual_kept**2)
        spread = np.array([a.scales[k, 0, 0], STEP, *left])[:size]
        return kept, np.array([a.means[k, 0], 0.0, 0.0, 0.0])[:size], np.diag(spread**2)

    shift = READING @ np.array([0.0, *a.centre])
    exact = switching_filter(a.initial, a.transition, first, later, (READING @ pose, shift, NOISE**2 * np.eye(2)), DATA)
    inputs = jax.tree.map(lambda leaf: jnp.stack([leaf] * len(DATA)), INPUTS)
    return Problem(None, model, model.observe({"y": DATA}), inputs, exact)


OTHER = ACTIVITY.with_other_motion(jnp.array([0.5, 0.3, 0.25]), 0.5, until=1.0, lasting=1.5, memory=1.0)


def posed_with_other_motion():
    """The problem of the activity or another motion, with its exact answer; the state is as above, its last phase the other."""
    inputs = INPUTS._replace(activity=OTHER)
    model = learned_motion(COORDINATES, LEARNED, read_pose).compile(inputs)
    a = jax.tree.map(lambda leaf: np.asarray(leaf, float), ACTIVITY)
    begins, ends = 1 - np.exp(-0.5 / np.array([1.0, 1.5]))
    initial = np.append(0.4 * a.initial, 0.6)
    transition = np.block([[(1 - begins) * a.transition, np.full((2, 1), begins)], [ends * a.initial, 1 - ends]])
    middle = a.initial @ a.means
    pose = np.zeros((3, 4))
    pose[1:, 0], pose[0, 1], pose[1:, 2:] = a.components[:, 0], 1.0, np.eye(2)

    def first(k):
        if k == 2:
            residual = START - a.centre - a.components @ middle
            return np.array([middle[0], START, *residual]), np.diag([1e-3, START_SCALE, START_SCALE, START_SCALE]) ** 2
        return np.array([a.means[k, 0], START, 0.0, 0.0]), np.diag([a.scales[k, 0, 0], START_SCALE, *a.residual_scale]) ** 2

    def later(j, k):
        if k == 2:
            left = np.exp(-0.5)
            back = np.array([(1 - left) * middle[0], 0.0, 0.0, 0.0])
            return np.diag([left, 1.0, left, left]), back, np.diag([1e-3, 0.5, 0.3, 0.25]) ** 2
        kept = a.residual_kept * (j != 2)
        spread = np.diag([a.scales[k, 0, 0], STEP, *a.residual_scale * np.sqrt(1 - kept**2)]) ** 2
        return np.diag([0.0, 1.0, *kept]), np.array([a.means[k, 0], 0.0, 0.0, 0.0]), spread

    seen = READING @ pose, READING @ np.array([0.0, *a.centre]), NOISE**2 * np.eye(2)
    exact = switching_filter(initial, transition, first, later, seen, DATA)
    rows = jax.tree.map(lambda leaf: jnp.stack([leaf] * len(DATA)), inputs)
    return Problem(None, model, model.observe({"y": DATA}), rows, exact)


FILTERS = {
    "particle": lambda model: particle_filter(model, 2000),
    "guided": lambda model: guided_filter(model, 500),
    "tempered": lambda model: tempered_filter(model, 400, moves=RANDOM_WALK_MOVES),
}


def check_moments(filter, problem, *, evidence):
    means, seconds, increments = replicate(filter, problem, 40)
    assert np.abs(z_scores(means, problem.exact.means)).max() < 5
    assert np.abs(z_scores(seconds, problem.exact.covariances)).max() < 5
    if evidence:
        ratios = np.exp(increments - problem.exact.log_evidence)
        assert (np.abs(ratios.mean(0) - 1) < 5 * ratios.std(0, ddof=1) / np.sqrt(40) + 1e-4).all()


@pytest.mark.full
@pytest.mark.parametrize("residual", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["on", "about"])
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == "guided" else pytest.mark.slow) for name in FILTERS])
def test_filters_have_the_moments_of_all_sequences(name, residual):
    problem = posed(residual)
    check_moments(FILTERS[name](problem.model), problem, evidence=name != "tempered")


@pytest.mark.full
@pytest.mark.parametrize("name", ["guided", pytest.param("particle", marks=pytest.mark.slow)])
def test_other_motion_has_the_moments_of_all_sequences(name):
    """Its probability, too; and another duration of it is noticed."""
    problem = posed_with_other_motion()
    build = FILTERS[name]
    check_moments(build(problem.model), problem, evidence=True)
    longer = ACTIVITY.with_other_motion(jnp.array([0.5, 0.3, 0.25]), 0.5, until=1.0, lasting=15.0, memory=1.0)
    wrong = jax.tree.map(lambda leaf: jnp.stack([leaf] * len(DATA)), INPUTS._replace(activity=longer))
    means, _, _ = replicate(build(problem.model), problem._replace(inputs=wrong), 40)
    assert np.abs(z_scores(means, problem.exact.means)).max() > 10


@pytest.mark.full
def test_other_motion_keeps_the_chances_of_the_start():
    """A start that is known chooses among the phases of the activity; that of other motion is as likely as before."""
    near = OTHER.starting_from(ACTIVITY.angles(ACTIVITY.means[1]), jnp.full(2, 0.1))
    assert near.initial[2] == OTHER.initial[2]
    np.testing.assert_allclose(near.initial[:2].sum(), OTHER.initial[:2].sum(), rtol=1e-6)
    assert near.initial[1] > 0.95 * near.initial[:2].sum()


@pytest.mark.full
def test_other_chances_of_the_phase_are_noticed():
    problem = posed(False)
    turned = problem.inputs._replace(
        activity=problem.inputs.activity._replace(transition=problem.inputs.activity.transition[:, ::-1])
    )
    means, _, _ = replicate(FILTERS["guided"](problem.model), problem._replace(inputs=turned), 40)
    assert np.abs(z_scores(means, problem.exact.means)).max() > 20


@pytest.mark.slow
def test_an_annealed_filter_leaves_phases_as_they_are_drawn():
    problem = posed(True)
    states, infos = jax.jit(lambda key, *data: run(annealed_filter(problem.model, 200, num_layers=4), key, *data))(
        jax.random.key(0), problem.observations, problem.inputs
    )
    assert set(np.unique(states.particles[:, :, 0])) == {0.0, 1.0}
    assert np.isfinite(states.particles).all() and not infos.failed.any()


@pytest.mark.full
def test_an_auxiliary_filter_is_refused():
    with pytest.raises(UnsuitableModelError, match="'phase' takes integers"):
        guided_filter(posed(True).model, 10, auxiliary=True)


@pytest.mark.full
def test_a_phase_that_follows_from_a_real_site_is_refused():
    def start(params, *rest):
        x = numpyro.sample("x", dist.Normal(0.0, 1.0))
        numpyro.sample("k", dist.Bernoulli(logits=x))

    model = StateSpaceModel(
        start, start, lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 1.0))
    ).compile()
    with pytest.raises(UnsuitableModelError, match="'k' of the initial program depends on 'x'"):
        guided_filter(model, 10).init(jax.random.key(0), model.observe({"y": 0.0}), None)
