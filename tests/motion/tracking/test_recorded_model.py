"""The model in a result: a file never chooses which code runs."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import pkgutil
import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import jax
import numpy as np
import poseppl_models
import pytest

import poseppl.motion.bodies.body
from poseppl.cli import main
from poseppl.errors import InputError
from poseppl.motion.bodies.body import Body, body_builder, load_builder
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import SmoothSettings, Tracked, TrackSettings, observe_motion, smooth, track
from poseppl.motion.tracking.placing import place_cameras
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.runs.results import save_result

ARM = "poseppl_models.bodies.choo_fleet:arm"
OWN = """
from pathlib import Path
from poseppl_models.bodies.choo_fleet import arm
Path({mark!r}).touch()
def build(lengths=None):
    return arm(lengths)
"""
FAILING = """
import numpyro
import numpyro.distributions as dist
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.choo_fleet import full_body
def transition(params, pose, inputs):
    numpyro.sample("pose", dist.Normal(0.9 * pose, inputs.step_scale))
def build(lengths=None):
    body = full_body(lengths)
    return body._replace(program=StateSpaceModel(body.program.initial, transition, body.program.observation))
"""


@pytest.fixture(scope="module")
def tracked() -> Tracked:
    subject = walking_subject(ARM, frames="0:3")
    scene = observe_motion(subject, place_cameras(subject.markers[:, 0], 0.0), ("camera",))
    return track(scene, TrackSettings(ARM, "kalman", {"num_particles": 20}))


@pytest.fixture(scope="module")
def result(tracked: Tracked) -> Any:
    return tracked.result


def saying(result: Any, **attrs: Any) -> Any:
    """The result with other attributes."""
    other = result.copy()
    other.attrs = {**result.attrs, **{name: json.dumps(value) for name, value in attrs.items()}}
    return other


@pytest.mark.full
def test_what_was_tracked_is_smoothed_as_its_result_is(tracked: Tracked) -> None:
    """The problem is the one in a result, with six digits of the lengths, which are round numbers here."""
    one, two = (smooth(each, SmoothSettings("rauch-tung-striebel")) for each in (tracked, tracked.result))
    for name in ("unconstrained_posterior/state", "posterior/markers", "summary/state_sd"):
        np.testing.assert_array_equal(one[name].to_numpy(), two[name].to_numpy())
    with pytest.raises(InputError, match="prior: the result was tracked with a learned prior"):
        smooth(tracked._replace(result=saying(tracked.result, prior="walk.nc")))


@pytest.mark.full
def test_first_frames_are_a_problem_of_their_own(tracked: Tracked) -> None:
    first = tracked.problem.first_frames(2)
    assert {len(leaf) for leaf in jax.tree.leaves(first.observations)} == {2}
    whole, part = tracked.problem.record(slice(2)), first.record()
    assert whole.keys() == part.keys() and part["step_scale"].shape[0] == 2
    for name, values in part.items():
        np.testing.assert_array_equal(values, whole[name])


@pytest.mark.full
def test_the_tree_of_a_result_keeps_what_it_knows_to_be_zero(result: Any) -> None:
    body = recorded_model(result).body
    rounded = recorded_model(saying(result, lengths={name: value + 1e-4 for name, value in body.lengths.items()})).body
    assert rounded.tree.marker_pattern == body.tree.marker_pattern
    moved = recorded_model(saying(result, lengths={name: value + 1.0 for name, value in body.lengths.items()})).body
    assert moved.tree.marker_pattern != body.tree.marker_pattern


@pytest.mark.full
def test_no_function_that_a_file_names_is_called(result: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    called: list[Any] = []
    monkeypatch.setattr(os, "system", called.append)
    Path("beside.py").write_text(OWN.format(mark=str(tmp_path / "ran")))
    names = [
        "os:system",
        "beside:build",
        "beside.py:build",
        f"{tmp_path}/beside.py:build",
        "poseppl_models.bodies.gait:walk",
        "",
        ":",
        7,
    ]
    for name in [
        *names,
        "poseppl_models.bodies.choo_fleet:measure",
        "poseppl.runs.results:load_result",
        None,
        ["os:system"],
        {"a": 1},
    ]:
        bad = saying(result, model=name, lengths="touch ran")
        with pytest.raises(InputError, match="installed|does not state"):
            smooth(bad, SmoothSettings("rauch-tung-striebel"))
    save_result(saying(result, model="beside:build", lengths="touch ran"), "bad.nc")
    assert main(["smooth", "bad.nc", "-q"]) == 1
    assert not called and not Path("ran").exists() and "beside" not in sys.modules
    load_builder("os:system")("it would notice")  # the user's own word
    assert called == ["it would notice"]


@pytest.mark.full
def test_a_body_of_ones_own_is_named_by_its_user(result: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN.format(mark=str(tmp_path / "ran")))
    source = poseppl.motion.bodies.body.source_of_model("own.py:build")
    tree = saying(result, **{"model": "own.py:build", "model source": source})
    with pytest.raises(InputError, match=r"'own.py:build', which is not installed.*model='BUILDER'"):
        recorded_model(tree)
    assert not Path("ran").exists()
    smoothed = smooth(tree, SmoothSettings("rauch-tung-striebel", model="own.py:build"))
    assert Path("ran").exists() and json.loads(smoothed.attrs["model"]) == "own.py:build"
    plain = smooth(result, SmoothSettings("rauch-tung-striebel"))
    np.testing.assert_array_equal(smoothed["unconstrained_posterior/state"], plain["unconstrained_posterior/state"])
    Path("ran").unlink()
    Path("own.py").write_text("import os\n")
    with pytest.raises(InputError, match="no longer, what the result was made with"):
        recorded_model(tree, "own.py:build")
    with pytest.raises(InputError, match="other coordinates"):
        recorded_model(result, "poseppl_models.bodies.choo_fleet:full_body")


@pytest.mark.full
def test_bodies_of_other_packages_are_found_by_their_entry_points(result: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = EntryPoint("arm-of-theirs", ARM, "poseppl.models")
    monkeypatch.setattr(poseppl.motion.bodies.body, "entry_points", lambda group: [entry] if group == entry.group else [])
    monkeypatch.setattr("poseppl.motion.tracking.recorded_model.BODIES", ())
    assert recorded_model(result).name == ARM
    assert recorded_model(saying(result, model="arm-of-theirs")).name == "arm-of-theirs"
    assert body_builder("arm-of-theirs") is body_builder(ARM)
    monkeypatch.setattr(poseppl.motion.bodies.body, "entry_points", lambda group: [])
    with pytest.raises(InputError, match="which is not installed"):
        recorded_model(result)


@pytest.mark.full
@pytest.mark.parametrize("field", ["lengths", "settings"])
@pytest.mark.parametrize("value", ["text", None, [1.0], float("nan"), float("inf"), True, 1e300, {"a": 1}])
def test_numbers_that_are_none_are_refused(result: Any, field: str, value: Any) -> None:
    name = {"lengths": "thigh", "settings": "sigma_angle"}[field]
    with pytest.raises(InputError, match=f"{field}: {name} is"):
        recorded_model(saying(result, **{field: {name: value}}))
    if not isinstance(value, dict):
        with pytest.raises(InputError, match=f"{field}: no numbers by name"):
            recorded_model(saying(result, **{field: value}))


@pytest.mark.full
def test_unknown_lengths_are_refused(result: Any) -> None:
    with pytest.raises(InputError, match="lengths: unknown name 'tail'"):
        recorded_model(saying(result, lengths={"tail": 100.0}))


def test_every_body_of_the_models_is_listed() -> None:
    found = set()
    for module in pkgutil.walk_packages(poseppl_models.__path__, "poseppl_models."):
        loaded = importlib.import_module(module.name)
        for name, function in inspect.getmembers(loaded, inspect.isfunction):
            hints = inspect.signature(function)
            if (
                function.__module__ == module.name
                and hints.return_annotation in ("Body", Body)
                and "lengths" in hints.parameters
            ):
                found.add(f"{module.name}:{name}")
    assert found == set(poseppl_models.BODIES)


@pytest.mark.full
@pytest.mark.parametrize(
    ("builder", "told"),
    [
        (
            "poseppl_models.bodies.cone_body:cone_body",
            "builds no body: TypeError.*missing 2 required positional arguments.*a function of seg",
        ),
        ("poseppl_models.bodies.joint_angles:joint_limits", "builds no body: AttributeError"),
        ("builtins:dict.fromkeys", "has no builder 'dict.fromkeys'"),
        ("builtins:repr", "returns a str"),
    ],
)
def test_a_function_that_builds_no_body_is_reported_in_one_message(builder: str, told: str, capsys: Any) -> None:
    assert main(["track", "--model", builder, "-o", "never.nc"]) == 1
    message = capsys.readouterr().err
    assert re.search(f"^poseppl: --model: .*{told}", message) and "unexpected" not in message and message.count("\n") == 1


@pytest.mark.full
def test_a_program_that_fails_is_reported_as_the_models(capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(FAILING)
    assert main(["track", "--model", "own.py:build", "-o", "never.nc", "--quiet"]) == 1
    message = capsys.readouterr().err
    assert re.search(
        r"^poseppl: --model: The transition program fails: TypeError.*the state as a dict of its sites \['spine_", message
    )
