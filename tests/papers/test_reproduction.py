from __future__ import annotations

import csv

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_papers.choo_fleet import EXPERIMENT, Scale
from poseppl_papers.choo_fleet.frame_tables import frame_errors, geometric_variance, log_standard_error
from poseppl_papers.choo_fleet.single_frame import FrameRuns, block_size, estimate_frame, particle_estimates
from poseppl_papers.choo_fleet.systems import SYSTEMS, frame_of
from poseppl_papers.page import page_of
from poseppl_papers.recordings import BUILT_IN
from poseppl_papers.reproduction import reproduce
from poseppl_papers.tables import Kept, Provenance, Table, read_folder, write_folder

from poseppl.filters import particle_filter

TUNING = ("leapfrog", "step_size", "rejection", "rejection_standard_error", "tau", "gradients_per_draw", "log_standard_error")
TINY = Scale(
    runs=4,
    block=2,
    num_settings=2,
    reference_chains=40,
    check_runs=3,
    check_particles=50,
    systems=("arm",),
    sequence_systems=("arm",),
    other_system="arm",
    num_frames=3,
    particles={"arm": 300},
    num_leapfrogs=(1, 2),
    tuning_updates=1,
    tuning_runs=2,
    contestants=("assumed density", "extended Kalman"),
    contest_runs=2,
    smoothers=(("NUTS on all frames", (("num_draws", 5), ("num_warmup", 5))),),
)


@pytest.fixture(scope="module")
def arm_runs():
    job = FrameRuns(BUILT_IN, "arm", 30, tuple(range(24)), 5, 40)
    return job, {job.key: estimate_frame(job)}


@pytest.mark.slow
def test_variance_falls_as_one_over_the_number_of_draws(arm_runs):
    job, results = arm_runs
    errors = frame_errors([job], results, "arm")[0]
    squared = errors.squared["particle"]
    logs, spread = np.log(geometric_variance(squared)), log_standard_error(squared)
    fall = logs[1] - logs[4]
    assert abs(fall - np.log(8)) < 4 * np.hypot(spread[1], spread[4])
    # a variance that does not fall is seen
    assert abs(0.0 - np.log(8)) > 4 * np.hypot(spread[1], spread[4])
    chains = np.log(geometric_variance(errors.squared["hmc"]))
    assert chains[4] < chains[0] - 1


@pytest.mark.slow
def test_both_filters_agree_with_the_reference(arm_runs):
    job, results = arm_runs
    found = results[job.key]
    variance = np.diagonal(found["reference_covariance"], axis1=1, axis2=2)
    for method in ("particle", "hmc"):
        scaled = (found[f"{method}_means"][:, -1] - found["reference_mean"]) / np.sqrt(variance)
        error = scaled.std(0, ddof=1) / len(scaled) ** 0.5
        # a self-normalised mean of n draws is biased by about 1/n
        allowed = 4.5 * error + (1 / found["particle_ess"][:, -1].mean() if method == "particle" else 0.0)
        assert (np.abs(scaled.mean(0)) < allowed).all()


@pytest.mark.slow
def test_blocks_of_particles_are_one_large_filter():
    system = SYSTEMS["arm"]
    frame = frame_of(BUILT_IN, "arm", 20)
    inputs, observation = frame.inputs, frame.observe(0)
    model = frame_of(BUILT_IN, "arm", 1).problem.model
    found = jax.jit(particle_estimates(model, system, 2))(jax.random.key(3), observation, inputs)
    size, number = block_size(system.num_particles)
    assert (size, number) == (320, 1)
    block = jax.jit(particle_filter(model, size).init)
    parts = [block(jax.random.fold_in(jax.random.key(3), index), observation, inputs)[0].particles for index in range(2)]
    weights = jax.vmap(lambda x: model.log_observation(x, observation, inputs))(jnp.concatenate(parts))
    expected = jax.nn.softmax(weights) @ jnp.concatenate(parts)
    np.testing.assert_allclose(found.means[1], expected, rtol=2e-4)
    np.testing.assert_allclose(found.ess[1], 1 / jnp.sum(jax.nn.softmax(weights) ** 2), rtol=1e-3)
    # the plain average of the blocks' means would be noticed
    halves = [jax.nn.softmax(part) @ values for part, values in zip(jnp.split(weights, 2), parts, strict=True)]
    assert not np.allclose((halves[0] + halves[1]) / 2, expected, rtol=2e-4, atol=0.0)
    assert list(found.num_likelihood) == [320, 640]


@pytest.mark.full
@pytest.mark.parametrize(("number", "expected"), [(320, (320, 1)), (27_000, (13_500, 2)), (108_000, (13_500, 8))])
def test_blocks_are_equal(number, expected):
    assert block_size(number) == expected


@pytest.mark.slow
def test_everything_at_a_tiny_size(tmp_path):
    tables = reproduce(EXPERIMENT, tmp_path, scale=TINY, executor="inline")
    page = (tmp_path / "page.md").read_text()
    assert "| claim | published | ours | verdict | why |" in page and "4-D arm" in page
    for name, table in tables.items():
        with (tmp_path / f"{name}.csv").open() as file:
            rows = list(csv.reader(file))
        assert tuple(rows[0]) == table.columns and len(rows) == len(table.rows) + 1
    for picture in ("variances.png", "sequence.png", "tuning.png", "contest.png", "coordinates.png"):
        assert (tmp_path / picture).stat().st_size > 10_000 and picture in page
    variances = tables["variances"]
    assert (variances.column("seconds") > 0).all() and np.isfinite(variances.column("variance")).all()
    assert set(tables["contest"].column("method")) == set(TINY.contestants)


@pytest.mark.slow
def test_a_second_call_reads_what_the_first_computed(tmp_path):
    smallest = TINY._replace(runs=2, num_settings=1)
    tuning = Table("tuning", TUNING, [(10, 0.35, 0.15, 0.0, 1.4, 14.0, 0.1)])
    write_folder(tmp_path, {"tuning": Kept(tuning, Provenance("10", "walk", "2026-01-02", "jax 0.0", "before"))})
    first = reproduce(EXPERIMENT, tmp_path, scale=smallest, executor="inline", parts=["single-frame"])
    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "jobs").iterdir()}
    again = reproduce(EXPERIMENT, tmp_path, scale=smallest, executor="inline", parts=["single-frame"])
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "jobs").iterdir()} == written
    assert again["variances"].rows == first["variances"].rows and len(first["variances"].rows) == 6
    # parts of an earlier call stay on the page, with their own number of runs
    page = (tmp_path / "page.md").read_text()
    assert "4-D arm" in page and "Best step size" in page and page == page_of(EXPERIMENT, tmp_path)
    kept = read_folder(tmp_path)
    assert (kept["tuning"].made.runs, kept["volumes"].made.runs) == ("10", "2 (a smaller size than the paper's)")
    assert kept["volumes"].made.recordings == "built-in walk"


@pytest.mark.full
def test_the_full_plan_is_the_papers():
    jobs = EXPERIMENT.parts["single-frame"].plan(EXPERIMENT.full, [BUILT_IN])["frames"].jobs
    assert len(jobs) == 3 * 3 * 5 and sum(len(job.runs) for job in jobs) == 450
    sequences = EXPERIMENT.parts["sequence"].plan(EXPERIMENT.full, [BUILT_IN])["sequences"].jobs
    settings = {(job.system, job.method): dict(job.settings) for job in sequences}
    assert settings["lower_body", "particle filter"] == {"num_particles": 23_000}
    assert settings["full_body", "particle filter"] == {"num_particles": 108_000}
    assert (
        settings["full_body", "HMC filter"]["num_updates"] == 32 and settings["full_body", "HMC filter"]["num_leapfrog"] == 40
    )


@pytest.mark.full
def test_every_job_of_the_full_plan_has_a_name_and_a_cost():
    jobs = [
        job
        for part in EXPERIMENT.parts.values()
        for task in part.plan(EXPERIMENT.full, [BUILT_IN]).values()
        for job in task.jobs
    ]
    assert all(job.cost > 0 and job.name for job in jobs)
    assert len({job.key for job in jobs}) == len(set(jobs))
