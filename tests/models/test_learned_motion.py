"""Programs of learned activities against hmmlearn's inference, and against enumeration."""

from __future__ import annotations

import hmmlearn.hmm
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from law_problems import run
from poseppl_models.bodies.learned_motion import Activity
from poseppl_models.darby.marker_body import full_body
from precision import precision
from synthetic_walks import walk, walks

from poseppl.filters import hidden_markov_filter
from poseppl.motion.bodies.subject import fit_subject
from poseppl.motion.io import slice_frames
from poseppl.motion.learned import TrainingSettings, pose_recording, read_recording, train_motion_model
from poseppl.program import StateSpaceModel
from poseppl.smoothers import collect_history, forward_backward_smoother

pytestmark = pytest.mark.full

SETTINGS = TrainingSettings(num_components=2, num_states=6, num_rounds=10)


def observed_phases(activity, noise=None):
    """The model of the phase alone: its features observed, or summed out where their angles are observed with noise R (L, L).

    y ~ N(mean + Phi f, R) gives p(y | s) = N(y; mean + Phi mu_s, Phi Sigma_s Phi^T + R): finitely many states, solved exactly.
    """
    covariances = activity.scales @ jnp.swapaxes(activity.scales, 1, 2)
    name, means = "features", activity.means
    if noise is not None:
        name, means = "angles", jax.vmap(activity.angles)(activity.means)
        covariances = activity.components @ covariances @ activity.components.T + jnp.asarray(noise)
    lower = jnp.linalg.cholesky(covariances)

    def sample(probabilities):
        numpyro.sample("phase", dist.Categorical(probs=probabilities))

    def observation(params, state, inputs):
        numpyro.sample(name, dist.MultivariateNormal(means[state["phase"]], scale_tril=lower[state["phase"]]))

    return StateSpaceModel(
        lambda params, inputs: sample(activity.initial),
        lambda params, state, inputs: sample(activity.transition[state["phase"]]),
        observation,
    )


def posteriors(model, data):
    """Log-likelihood and smoothed probabilities (T, N) of a model of finitely many states, by ours."""

    @jax.jit
    def infer(observations):
        key = jax.random.key(0)
        states, infos = run(hidden_markov_filter(model), key, observations, None)
        history = jax.vmap(lambda state, info: collect_history(None, state, info, None))(states, infos)
        return infos.log_evidence.sum(), forward_backward_smoother(model).smooth(key, history, observations, None)

    evidence, smoothed = infer(model.observe(data))
    return float(evidence), np.exp(smoothed.log_weights)


def reference(model):
    """The same model as hmmlearn has it."""
    known = hmmlearn.hmm.GaussianHMM(len(model.means), "full")
    known.startprob_, known.transmat_, known.means_, known.covars_ = (
        model.initial,
        model.transition,
        model.means,
        model.covariances,
    )
    return known


def check_inference(model, features):
    with precision(np.float64):
        compiled = observed_phases(Activity.of_model(model)).compile()
        evidence, probabilities = posteriors(compiled, {"features": features})
    known = reference(model)
    assert evidence == pytest.approx(known.score(features), rel=1e-9)
    np.testing.assert_allclose(probabilities, known.predict_proba(features), atol=1e-9)
    mistaken = reference(model._replace(transition=np.roll(model.transition, 1, 1)))
    assert abs(mistaken.score(features) - evidence) > 1


def test_inference_is_that_of_hmmlearn_on_another_walk():
    model = train_motion_model(walks(), "walks", SETTINGS)
    other = walk("tall", np.array([0.2, 0.0, 3.1]), frames=60, seed=5)
    check_inference(model, model.features(other.states, "tall"))


@pytest.fixture(scope="module")
def recorded(data_dir):
    """A walk of each of the people 07, 16 and 35 for learning, at 30 frames a second, and another one of the second."""
    folder = data_dir / "cmu_walks"
    body = "poseppl_models.darby.marker_body:full_body"
    return [pose_recording(read_recording(folder / f"{name}.amc"), body, 30.0) for name in ("07_01", "16_15", "35_05", "16_31")]


@pytest.mark.slow
def test_inference_is_that_of_hmmlearn_on_held_out_recordings(recorded):
    *known, held_out = recorded
    model = train_motion_model(known, "poseppl_models.darby.marker_body:full_body", TrainingSettings(num_states=15))
    assert 0.85 < model.explained < 0.99 and len(model.learned) == 22
    check_inference(model, model.features(held_out.states, "16"))
    apart = model.angles(model.features(held_out.states, "16"), "16") - held_out.states[:, model.learned]
    assert np.sqrt(np.mean(apart**2)) < 0.1


def test_the_ten_cone_body_fits_a_recorded_walk(data_dir):
    motion = slice_frames(read_recording(data_dir / "cmu_walks" / "16_15.amc").motion, "0:120:12")
    subject = fit_subject(motion, full_body)
    assert subject.residual < 3
    assert 390 < subject.body.lengths["thigh"] < 470 and set(subject.body.lengths) == set(full_body().lengths)
    np.testing.assert_allclose(
        subject.markers[:, subject.body.tree.marker_names.index("pelvis")],
        np.mean([subject.markers[:, subject.body.tree.marker_names.index(f"hip_{side}")] for side in "lr"], 0),
    )


def test_summed_features_are_those_of_all_sequences():
    """Two phases, two frames: the density of noisy angles against a sum over sequences of joint Gaussians."""
    model = train_motion_model(walks(), "walks", SETTINGS._replace(num_states=2, num_components=1))
    noise = np.diag([0.1, 0.2, 0.3]) ** 2
    ys = model.mean_angles() + np.array([[0.3, 0.1, -0.2], [-0.2, 0.3, 0.1]])
    total = 0.0
    for first in (0, 1):
        for second in (0, 1):
            probability = model.initial[first] * model.transition[first, second]
            for y, state in zip(ys, (first, second), strict=True):
                mean = model.mean_angles() + model.components @ model.means[state]
                covariance = model.components @ model.covariances[state] @ model.components.T + noise
                probability *= scipy.stats.multivariate_normal(mean, covariance).pdf(y)
            total += probability
    with precision(np.float64):
        compiled = observed_phases(Activity.of_model(model), noise).compile()
        assert posteriors(compiled, {"angles": ys})[0] == pytest.approx(np.log(total), rel=1e-9)
