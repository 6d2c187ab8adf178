"""People of other lengths share one compiled program: what tells them apart is an argument."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from poseppl_models.bodies import choo_fleet, silhouettes

from poseppl.filters import assumed_density_filter
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import look_at, marker_positions
from poseppl.motion.likelihoods import SilhouetteSeen
from poseppl.motion.tracking import make_problem, observe_motion
from poseppl.particles.stacks import tree_index
from poseppl.runs.frame_sequence import frame_inputs

OTHER = {"thigh": 390.0, "shoulder_forward": 20.0, "hip_forward": -35.0, "shoulder_drop": 0.0}


def points_of(body):
    size = np.ones(body.tree.dimension)
    return BodyInputs(look_at((0, -5000, 1000), (0, 0, 1000)), np.full((1, 17), 0.003), body.rest, size, size, body.tree)


def silhouettes_of(body):
    size, camera = np.ones(body.tree.dimension), look_at((0, -5000, 1000), (0, 0, 1000), 800.0)
    seen = SilhouetteSeen(np.zeros((1, 64, 2)), np.zeros((1, 60, 80), np.float32), np.ones(1))
    return BodyInputs(camera, np.ones(1), body.rest, size, size, body.tree, seen=seen, flesh=body.flesh)


@pytest.mark.full
@pytest.mark.parametrize(
    "build, inputs_of",
    [(choo_fleet.full_body, points_of), (silhouettes.full_body, silhouettes_of)],
    ids=["points", "silhouettes"],
)
def test_programs_of_two_people_are_the_same_text(build, inputs_of):
    texts = []
    for lengths in (None, OTHER):
        body = build(lengths)
        inputs = jax.tree.map(lambda leaf: jax.numpy.asarray(leaf, float), inputs_of(body))
        model = body.program.compile(inputs, dict(body.params))
        data = model.unobserved()
        x = jax.numpy.asarray(body.rest, float)

        def density(x, data, inputs, model=model):
            return model.log_observation(x, data, inputs) + sum(model.extras(x, inputs)["markers"].ravel())

        texts.append(jax.jit(jax.value_and_grad(density)).lower(x, data, inputs).as_text())
    assert texts[0] == texts[1]


@pytest.mark.full
def test_recordings_of_two_people_share_model_filter_and_collector():
    problems = []
    for lengths in (None, OTHER):
        body = choo_fleet.full_body(lengths)
        states = np.tile(np.asarray(body.rest), (3, 1))
        markers = np.stack([np.asarray(marker_positions(body.tree, jax.numpy.asarray(state))) for state in states])
        subject = MovingSubject(body, states, markers, None, np.arange(3), 30.0, "at ease")
        problems.append(make_problem(observe_motion(subject, look_at((0, -5000, 1000), (0, 0, 1000)), ["camera"])))
    first, second = problems
    assert first.model is second.model and first.collector(2) is second.collector(2)
    assert assumed_density_filter(first.model) is assumed_density_filter(second.model)


@pytest.mark.parametrize("lengths", [None, OTHER], ids=["standard", "other"])
def test_a_person_is_seen_with_the_lengths_that_are_given(lengths):
    """The squares of 34 residuals at the truth sum to 34 on average, with a standard deviation of sqrt(68)."""
    body = choo_fleet.full_body(lengths)
    x = np.asarray(body.rest)[None]
    subject = MovingSubject(body, x, body.places(x), None, np.arange(1), 30.0, "at ease")
    problem = make_problem(observe_motion(subject, look_at((0, -5000, 1000), (0, 0, 1000)), ["camera"], noise=0.0003))
    inputs, data = frame_inputs(problem.inputs, 0), tree_index(problem.observations, 0)
    mean, covariance = problem.model.observation_moments(jax.numpy.asarray(x[0], float), inputs)
    seen, _ = problem.model.flat_observation(data)
    assert seen.shape == (34,)
    assert abs(np.sum((np.asarray(seen) - mean) ** 2 / np.diagonal(covariance)) - 34) < 5 * np.sqrt(68)
