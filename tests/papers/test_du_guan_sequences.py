"""Du and Guan's sequences and the scales of their cues: the plans, and the verdicts of tables made by hand."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from poseppl_papers.du_guan.claims import claims, scales, sequences
from poseppl_papers.du_guan.mueller import DEMC, DYNAMICS, EXACT
from poseppl_papers.du_guan.plan import CHOSEN, CUES, FULL, plan_noise, plan_scales, plan_sequences
from poseppl_papers.images.tables import COLUMNS, filter_rows
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table, grouped, read_folder

DOCS = Path(__file__).resolve().parents[2] / "docs"
RECORDINGS = [Recording(name, f"/there/{name}.amc", "/there/02.asf", name) for name in ("walk", "jump", "run")]
METHOD = "DE-MC (velocity), 9 layers of 600"


def test_the_first_sequence_has_fewer_particles():
    tasks = plan_sequences(FULL, RECORDINGS)
    found = {(job.scene.recording.name, job.method.settings[:3]) for job in tasks["tracking"].jobs}
    sizes = {"walk": (7, 500), "jump": (9, 600), "run": (9, 600)}
    expected = {
        (name, (("num_layers", layers), ("num_particles", members), ("prediction", "velocity")))
        for name, (layers, members) in sizes.items()
    }
    assert (
        found == expected and len(tasks["tracking"].jobs) == 12 and len(tasks["scenes"].jobs) == len(tasks["blind"].jobs) == 3
    )


def test_one_scale_is_changed_at_a_time():
    systems = {job.system for job in plan_scales(FULL, RECORDINGS)["tracking"].jobs}
    assert len({system.name for system in systems}) == len(systems) == 1 + 2 * len(CUES)
    changed = [system.settings for system in systems if system.settings]
    assert all(len(settings) == 1 for settings in changed)
    assert {round(value / CUES[cue], 3) for ((cue, value),) in changed} == {0.333, 3.0}


def row(method: str, error: float, spread: float = math.nan, system: str = "du-guan") -> tuple[object, ...]:
    head = (system, "jump-clean", 1, 40, 1 if method == HOLDING else 4, method, 5400)
    return *head, error, spread, error / 2, spread, error, spread, error, spread, 0.5, 0.1, 0.01, 0


@pytest.mark.parametrize(("error", "verdict"), [(150.0, "holds"), (179.0, "undecided"), (205.0, "does not hold")])
def test_a_sequence_is_followed_that_is_closer_than_its_first_pose(error, verdict):
    table = Table("sequences", COLUMNS, [row(HOLDING, 200.0), row(METHOD, error, 10.0)])
    (claim,) = claims({"sequences": table})
    assert claim.verdict == f"{verdict} on one recording (absolute {verdict}, relative {verdict})"
    assert "9 layers of 600 particles follow jump-clean" in claim.what and "200" in claim.ours
    assert "| jump-clean | DE-MC (velocity), 9 layers of 600 |" in sequences({"sequences": table})
    assert "200 and 100" in sequences({"sequences": table})


def test_a_sequence_whose_place_alone_is_followed_is_not():
    """A quarter of the held pose's absolute error, and twice its relative one."""
    place = COLUMNS.index("relative")
    ours = row(METHOD, 50.0, 5.0)
    table = Table("sequences", COLUMNS, [row(HOLDING, 200.0), (*ours[:place], 200.0, *ours[place + 1 :])])
    (claim,) = claims({"sequences": table})
    assert claim.verdict == "does not hold on one recording (absolute holds, relative does not hold)"


def test_the_noise_is_chosen_on_other_walks():
    """The choice follows from the committed table; none of its walks is among the judged sequences."""
    kept = {name: each.table for name, each in read_folder(DOCS / "du-guan-2006").items()}
    groups = grouped(filter_rows(kept, "noise"), lambda row: row["method"])
    least = min(groups, key=lambda name: sum(row["absolute"] for row in groups[name]))
    assert least == f"{CHOSEN[0]:g}, {CHOSEN[1]}, {CHOSEN[2]}"
    assert not set(kept["noise"].values("scene")) & {*kept["sequences"].values("scene"), *kept["trackers"].values("scene")}
    jobs = plan_noise(FULL, RECORDINGS[:2])["tracking"].jobs
    assert {job.method.name for job in jobs} == set(groups) and all(len(job.runs) == 5 for job in jobs)


def basins(temperature: float, well: float, trapped: float) -> list[tuple[object, ...]]:
    """Shares of the basins at a temperature: a third each, of DE-MC ``well`` in A, of the dynamics ``trapped`` in B."""
    rest = [(temperature, EXACT, 33.0, 33.0, 33.0, 0.0, 0.0, 0.0, 0)]
    rest += [(temperature, DEMC, well, (100 - well) / 2, (100 - well) / 2, 1.0, 1.0, 1.0, 20)]
    return [*rest, (temperature, DYNAMICS, 50 - trapped / 2, trapped, 50 - trapped / 2, 1.0, 1.0, 1.0, 20)]


@pytest.mark.parametrize(("second", "verdict"), [((90.0, 20.0), "does not hold"), ((34.0, 99.0), "holds")])
def test_one_temperature_has_to_show_both(second, verdict):
    columns = ("temperature", "method", "a", "b", "c", "a_reach", "b_reach", "c_reach", "runs")
    table = Table("mueller", columns, basins(5.0, 99.0, 99.0) + basins(50.0, *second))
    *_, last = claims({"mueller": table})
    assert last.what.startswith("Section 2.2: at one temperature") and last.verdict == verdict


@pytest.mark.full
def test_scales_are_reported_by_their_cue():
    rows = [row(METHOD, 100.0, 5.0), row(METHOD, 120.0, 5.0, "colour_scale 0.9")]
    told = scales({"scales": Table("scales", COLUMNS, rows)}).splitlines()
    assert told[2].startswith("| as above | 100 +- 5 |") and told[3].startswith("| colour scale 0.9 | 120 +- 5 |")
    assert scales({}) == sequences({}) == ""
