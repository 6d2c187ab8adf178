"""Plans of experiments in images: what the papers ran, and jobs that other processes can tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from poseppl_papers.catalogue import find_experiment
from poseppl_papers.images.scenes import Scene
from poseppl_papers.images.systems import System
from poseppl_papers.images.tables import tracking_table
from poseppl_papers.images.tracking import CLOSEST, HOLDING, Blind, Tracking
from poseppl_papers.peursum.dimensionality import EXACT, FBS, GrowthRuns, dimensionality_tables
from poseppl_papers.peursum.plan import annealed
from poseppl_papers.peursum.tables import exponent_table
from poseppl_papers.recordings import BUILT_IN, Recording

WALK = Recording("walk", "/there/walk.amc", "/there/walk.asf", "0123")
PEOPLE = [
    WALK,
    *(Recording(name, f"/there/{name}.amc", f"/there/{name[0]}.asf", name) for name in ("a1", "a2", "a3", "b1", "b2")),
]
SCENE = Scene(WALK, clutter=False)
SYSTEM = System("peursum", "package.module:builder", 4)


@pytest.mark.parametrize("name", ["peursum-2010", "darby-2008", "du-guan-2006"])
def test_every_job_of_the_full_plan_has_a_name_and_a_cost(name):
    experiment = find_experiment(name)
    for scale in (experiment.full, experiment.quick):
        tasks = [task for part in experiment.parts.values() for task in part.plan(scale, PEOPLE).values()]
        jobs = [job for task in tasks for job in task.jobs]
        assert all(job.cost > 0 and job.name for job in jobs)
        assert len({job.key for job in jobs}) == len(set(jobs))


def evaluations(name: str, part: str) -> dict[str, int]:
    """Likelihoods a frame of each filter of a full plan."""
    experiment = find_experiment(name)
    jobs = experiment.parts[part].plan(experiment.full, [WALK])["tracking"].jobs
    settings = {job.method.name: (job.method.filter, dict(job.method.settings)) for job in jobs}
    populations = {"particle": 0, "annealed": 0, "demc": 1}  # DE-MC's first one is evaluated, too
    return {
        key: each["num_particles"] * (each.get("num_layers", 1) + populations[filter])
        for key, (filter, each) in settings.items()
    }


def test_the_full_plans_are_the_papers():
    peursum = evaluations("peursum-2010", "trackers")
    assert peursum == {"Simple-PF, 10,000": 10_000, "Simple-PF, 1,000": 1_000, "Simple-APF, 10 x 1,000": 10_000}
    assert evaluations("darby-2008", "one-camera")["APF, 5 x 40"] == 200
    found = evaluations("du-guan-2006", "trackers")
    assert found["CONDENSATION, 5,000"] == found["APF, 10 x 500"] == 5000
    assert all(0.99 * 3500 < number <= 3500 for name, number in found.items() if name.startswith("DE-MC"))


def test_parts_share_what_both_compute():
    experiment = find_experiment("peursum-2010")
    one, other = (
        set(experiment.parts[part].plan(experiment.full, [WALK])["tracking"].jobs) for part in ("trackers", "exponents")
    )
    assert {job.method.name for job in one & other} == {"Simple-PF, 10,000", "Simple-APF, 10 x 1,000"}


def test_a_scene_is_found_by_what_it_shows():
    moved = replace(SCENE, recording=replace(WALK, path="/elsewhere/walk.amc"))
    assert moved.folder == SCENE.folder and SCENE.name == "walk-clean"
    others = [replace(SCENE, clutter=True), replace(SCENE, rate=60.0), replace(SCENE, recording=BUILT_IN)]
    assert len({scene.folder for scene in (SCENE, *others)}) == 4


def test_settings_of_a_system_are_added_to_its_own():
    system = System("a", "b:c", 1, (("measured", True),)).with_settings(exponent=30.0)
    assert system.settings == (("exponent", 30.0), ("measured", True))


def found_by(job: Tracking, errors: list[float]) -> dict[str, np.ndarray]:
    """Results of two runs of three frames whose errors are given, those of the first frame being far off."""
    table = np.array(errors)[:, None, None] * np.array([1000.0, 0.5, 1.5])[None, :, None] * np.array([1.0, 0.5, 0.6, 0.8])
    shape = table.shape[:2]
    return {
        "errors": table,
        "seconds": np.broadcast_to([9.0, 0.1, 0.3], shape),
        "ess_share": np.broadcast_to([1.0, 0.2, 0.4], shape),
        "weight": np.broadcast_to([0.3, 0.2, 0.1], shape),
        "failed": np.broadcast_to([0, 1, 0], shape),
        "evaluations": np.full(len(errors), 77),
    }


def test_errors_are_means_over_runs_without_the_first_frame():
    jobs = [Tracking(SCENE, SYSTEM, 3, annealed(10), runs) for runs in ((0, 1), (2,))]
    blind = Blind(SCENE, SYSTEM, 3)
    results = {jobs[0].key: found_by(jobs[0], [10.0, 20.0]), jobs[1].key: found_by(jobs[1], [30.0])}
    results[blind.key] = {"errors": np.array([[[0.0] * 4, [40.0] * 4, [60.0] * 4], [[1.0] * 4] * 3])}
    held, closest, row = tracking_table("trackers", [blind], jobs, results).records()
    assert (held["method"], held["absolute"], closest["method"], closest["optimistic"]) == (HOLDING, 50.0, CLOSEST, 1.0)
    assert np.isnan(held["absolute_sd"]) and held["runs"] == 1
    expected = {"absolute": 20.0, "absolute_sd": 10.0, "relative": 10.0, "relative_sd": 5.0, "optimistic": 16.0}
    expected |= {"runs": 3, "evaluations": 77, "seconds": 0.2, "weight": 0.2, "failed": 3, "cameras": 4, "frames": 3}
    assert {name: row[name] for name in expected} == pytest.approx(expected) and row["scene"] == "walk-clean"


def test_each_run_has_a_row_in_the_table_of_exponents():
    job = Tracking(SCENE, SYSTEM.with_settings(exponent=30.0), 3, replace(annealed(10), name="Simple-PF, 10"), (4, 5))
    rows = exponent_table([job], {job.key: found_by(job, [10.0, 20.0])}).records()
    assert [(row["run"], row["exponent"], row["absolute"]) for row in rows] == [(4, "30", 10.0), (5, "30", 20.0)]
    assert rows[0]["ess_share"] == pytest.approx(0.3) and rows[0]["seconds"] == pytest.approx(0.2)


def test_the_share_of_the_error_that_is_left_is_a_ratio_of_means():
    jobs = [GrowthRuns(3, EXACT, 0, 3), GrowthRuns(3, FBS, 100, 3)]
    results = {
        jobs[0].key: {"filtered": np.array([2.0, 2.0, 2.0]), "smoothed": np.array([1.0, 1.0, 1.0])},
        jobs[1].key: {"filtered": np.array([2.0, 4.0, 6.0]), "smoothed": np.array([1.0, 3.0, 5.0])},
    }
    shares, all_of_them = dimensionality_tables(jobs, results)
    exact, found = shares.records()
    assert exact["share"] == 0.5 and np.isnan(exact["share_standard_error"])
    # 3 / 4; residuals -0.5, 0, 0.5 have a spread of 0.5
    assert found["share"] == 0.75 and found["share_standard_error"] == pytest.approx(0.5 / 4 / 3**0.5)
    assert [row[2] for row in all_of_them.rows] == ["filter", "exact", "filter", "FBS"]
