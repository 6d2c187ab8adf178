"""Du and Guan's sequences and the scales of their cues: the plans, and the verdicts of tables made by hand."""

from __future__ import annotations

import math

import pytest
from poseppl_papers.du_guan.claims import claims
from poseppl_papers.du_guan.plan import CUES, FULL, plan_scales, plan_sequences
from poseppl_papers.du_guan.tables import scales, sequences
from poseppl_papers.images.tables import COLUMNS
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table

RECORDINGS = [Recording(name, f"/there/{name}.amc", "/there/02.asf", name) for name in ("walk", "jump", "run")]
METHOD = "DE-MC (velocity), 9 layers of 600"


def test_the_first_sequence_has_fewer_particles():
    tasks = plan_sequences(FULL, RECORDINGS)
    found = {(job.scene.recording.name, job.method.settings) for job in tasks["tracking"].jobs}
    sizes = {"walk": (7, 500), "jump": (9, 600), "run": (9, 600)}
    expected = {
        (name, (("num_layers", layers), ("num_particles", members), ("prediction", "velocity")))
        for name, (layers, members) in sizes.items()
    }
    assert found == expected and len(tasks["tracking"].jobs) == 6 and len(tasks["scenes"].jobs) == len(tasks["blind"].jobs) == 3


def test_one_scale_is_changed_at_a_time():
    systems = {job.system for job in plan_scales(FULL, RECORDINGS)["tracking"].jobs}
    assert len({system.name for system in systems}) == len(systems) == 1 + 2 * len(CUES)
    changed = [system.settings for system in systems if system.settings]
    assert all(len(settings) == 1 for settings in changed)
    assert {round(value / CUES[cue], 3) for ((cue, value),) in changed} == {0.333, 3.0}


def row(method: str, error: float, spread: float = math.nan, system: str = "du-guan") -> tuple[object, ...]:
    head = (system, "jump-clean", 1, 40, 1 if method == HOLDING else 4, method, 5400)
    return *head, error, spread, error / 2, spread, error, spread, error, spread, 0.5, 0.1, 0.01, 0


@pytest.mark.parametrize(("error", "verdict"), [(150.0, "holds"), (199.0, "undecided"), (250.0, "does not hold")])
def test_a_sequence_is_followed_that_is_closer_than_its_first_pose(error, verdict):
    table = Table("sequences", COLUMNS, [row(HOLDING, 200.0), row(METHOD, error, 10.0)])
    (claim,) = claims({"sequences": table})
    assert claim.verdict == verdict and "9 layers of 600 particles follow jump-clean" in claim.what and "200" in claim.ours
    assert "| jump-clean | DE-MC (velocity), 9 layers of 600 |" in sequences({"sequences": table})
    assert "200 and 100" in sequences({"sequences": table})


@pytest.mark.full
def test_scales_are_told_by_their_cue():
    rows = [row(METHOD, 100.0, 5.0), row(METHOD, 120.0, 5.0, "colour_scale 0.9")]
    told = scales({"scales": Table("scales", COLUMNS, rows)}).splitlines()
    assert told[2].startswith("| as above | 100 +- 5 |") and told[3].startswith("| colour scale 0.9 | 120 +- 5 |")
    assert scales({}) == sequences({}) == ""
