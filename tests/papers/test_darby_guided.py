"""Darby's guided filter: whose recordings teach whom, the states of its system, and the verdicts."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.learned_motion import Activity
from poseppl_models.darby.learned_system import _groups, _guided
from poseppl_papers.darby import claims as darby
from poseppl_papers.darby.people import known, person_of, unknown
from poseppl_papers.darby.plan import FULL, plan_guided
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table
from synthetic_walks import walks

from poseppl.errors import InputError
from poseppl.motion.learned import TrainingSettings, train_motion_model

WALKS = [
    Recording(name, f"/there/{name}.amc", f"/there/{name[0]}.asf", name) for name in ("a1", "a2", "b1", "c1", "c2", "d1", "d2")
]
SIZES = {"frames": 100, "rate": 60.0, "rounds": 3}


def names(training):
    return [recording.name for recording in training.recordings]


def test_a_known_person_is_learned_from_its_other_recordings():
    assert names(known(WALKS[0], WALKS, **SIZES)) == ["a2"] and known(WALKS[0], WALKS, **SIZES).subject == "a"
    assert names(known(WALKS[4], WALKS, **SIZES)) == ["c1"]
    assert known(WALKS[2], WALKS, **SIZES) is None


def test_an_unknown_person_is_learned_from_three_others():
    found = unknown(WALKS[0], [*WALKS, Recording("e1", "e1.amc", "e.asf"), Recording("e2", "e2.amc", "e.asf")], **SIZES)
    assert names(found) == ["c1", "c2", "d1", "d2", "e1", "e2"] and found.subject == ""  # those of one recording come last
    assert names(unknown(WALKS[3], WALKS, **SIZES)) == ["a1", "a2", "b1", "d1", "d2"]
    with pytest.raises(InputError, match="one person alone"):
        unknown(WALKS[0], WALKS[:2], **SIZES)


def test_no_walk_is_tracked_with_what_was_learned_from_it():
    jobs = plan_guided(FULL, WALKS)["tracking"].jobs
    assert {job.scene.recording.name for job in jobs} == {"a1", "a2", "b1", "c1", "c2", "d1", "d2"}
    for job in jobs:
        assert job.scene.recording not in job.training.recordings
        mine = person_of(job.scene.recording) in {person_of(each) for each in job.training.recordings}
        assert mine == (job.system.name == "guided, known, two cameras") == bool(job.training.subject)
    assert [job.method.name for job in jobs if job.scene.recording.name == "b1"] == [
        "APF, 5 x 40",
        "APF, 5 x 200",
        "HMM-APF, 5 x 40",
    ]


@pytest.mark.full
def test_states_of_the_guided_system_are_phase_features_and_free_coordinates():
    model = train_motion_model(walks(), "walks", TrainingSettings(num_components=2, num_states=6, num_rounds=2))
    pose = np.random.default_rng(0).normal(size=len(model.coordinates))
    pose[model.learned] = model.angles(model.features(pose))
    motion = _guided(model, None)
    inputs = type("Inputs", (), {})()
    inputs.start, inputs.features = jnp.asarray(pose, float), jnp.asarray(model.features(pose), float)
    inputs.activity = Activity.of_model(model)
    state = motion.first(inputs)
    np.testing.assert_allclose(motion.poses(state[None], inputs)[0], pose, atol=1e-5)
    groups = _groups(model)
    assert sorted(index for group in groups for index in group) == list(range(len(state)))
    assert groups[0] == list(range(1 + model.components.shape[1]))


def guided_table(guided: list[float], standard: list[float]) -> Table:
    columns = ("system", "scene", "method", "evaluations", "runs", "optimistic")
    rows = [("standard, two cameras", f"w{at}", "APF, 5 x 40", 200, 10, 999.0) for at in range(len(standard))]
    rows += [("standard, two cameras", f"w{at}", "APF, 5 x 200", 1000, 10, error) for at, error in enumerate(standard)]
    for who in ("known", "unknown"):
        rows += [
            (f"guided, {who}, two cameras", f"w{at}", "HMM-APF, 5 x 40", 200, 10, error) for at, error in enumerate(guided)
        ]
    return Table("guided", columns, rows)


@pytest.mark.parametrize(
    ("guided", "verdict"), [([40.0, 41, 42], "holds"), ([70.0, 71, 72], "does not hold"), ([30.0, 50, 70], "undecided")]
)
def test_half_the_error_is_judged_over_walks_against_more_particles(guided, verdict):
    found = darby.claims({"guided": guided_table(guided, [100.0, 101.0, 99.0])})
    assert [claim.verdict for claim in found] == ["holds", verdict, verdict]  # the standard filter fails: 100 mm
    assert all("APF, 5 x 200" in claim.ours and "3 walks" in claim.ours for claim in found)


@pytest.mark.full
@pytest.mark.parametrize(
    ("tight", "verdict"), [([50.0, 52, 54], "holds"), ([80.0, 82, 84], "does not hold"), ([50.0, 62, 74], "undecided")]
)
def test_one_camera_is_judged_by_the_weighted_relative_error(tight, verdict):
    columns = ("system", "scene", "method", "evaluations", "runs", "absolute", "weighted_relative")
    rows = [("guided, known, gamma = 0", f"w{at}", "x", 200, 10, 400.0 + at, 90.0) for at in range(3)]
    rows += [("guided, known, gamma = 5", f"w{at}", "x", 200, 10, 200.0, error) for at, error in enumerate(tight)]
    sits, recovers, place = darby.claims({"guided_one_camera": Table("", columns, rows)})
    assert sits.verdict == "holds" and "201 mm more" in sits.ours
    assert recovers.verdict == verdict and place.verdict.startswith("measured")


def test_one_camera_is_judged_against_more_particles():
    columns = ("system", "scene", "method", "evaluations", "runs", "absolute", "weighted_relative", "optimistic")
    rows = [
        (f"guided, known, gamma = {gamma}", f"w{at}", "x", 200, 10, 200.0, 95.0, 40.0 + at)
        for at in range(3)
        for gamma in (0, 5)
    ]
    rows += [("standard, one camera", f"w{at}", "APF, 5 x 200", 1000, 10, 300.0, 100.0, 100.0) for at in range(3)]
    place, posture, *_ = darby.claims({"guided_one_camera": Table("", columns, rows)})
    assert place.verdict == "holds" and "59 % less" in place.ours
    assert posture.verdict == "does not hold"  # 5 % less do not matter
