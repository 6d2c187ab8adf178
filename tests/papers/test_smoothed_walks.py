"""The twelve algorithms on walks: densities, ancestors, the plan, and the verdicts of tables made by hand."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
from poseppl_models.bodies.factored_motion import factored_motion
from poseppl_papers.peursum.claims import walk_claims
from poseppl_papers.peursum.factored_draws import Particles, RootWalk, log_transition_matrix, reweigh
from poseppl_papers.peursum.factored_evidence import log_tables
from poseppl_papers.peursum.plan import FULL, QUICK, plan_walks
from poseppl_papers.peursum.tables import WALK_COLUMNS, kind_of, walks
from poseppl_papers.peursum.tracks import Track
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.tables import Table

from poseppl.errors import InputError
from poseppl.motion.learned import FactoredTables

COORDINATES = [("root", "tx"), ("root", "ty"), ("root", "tz"), ("root", "Z"), ("hip", "X"), ("knee", "X")]
NAMES = ("FSHHMM-PF, 1,000", "Simple-PF, 1,000")


class Inputs(NamedTuple):
    """Inputs of the programs."""

    activity: FactoredTables
    start: object
    start_scale: object
    step_scale: object
    seconds: float = 0.04


def tables_of(rng) -> FactoredTables:
    steps = rng.dirichlet(np.ones(5), (2, 2, 5))
    steps[0, 1, 3] = 0.0
    rows = (rng.dirichlet(np.ones(2)), rng.dirichlet(np.ones(5), (2, 2)), rng.dirichlet(np.ones(2), 2))
    tables = (*rows, rng.dirichlet(np.ones(5), (2, 2)), steps, 500 * rng.normal(size=(2, 3)))
    return FactoredTables(*(jnp.asarray(table, float) for table in tables), jnp.asarray(0.3))


def particles_of(rng, count: int) -> Particles:
    roots = rng.normal(size=(count, 4)) * np.array([10.0, 10.0, 10.0, 0.3])
    whole = rng.integers(0, 2, count), rng.integers(0, 5, (count, 2))
    return Particles(*(jnp.asarray(x) for x in whole), jnp.asarray(roots, float))


@pytest.mark.full
def test_looked_up_densities_are_those_of_the_program():
    rng = np.random.default_rng(0)
    tables, scales = tables_of(rng), jnp.asarray([8.0, 9.0, 10.0, 0.2])
    inputs = Inputs(tables, jnp.zeros(6), jnp.ones(6), jnp.concatenate([scales, jnp.ones(2)]))
    model = factored_motion(COORDINATES, lambda params, pose, inputs: numpyro.factor("seen", 0.0)).compile(inputs, {})
    later, earlier = particles_of(rng, 7), particles_of(rng, 6)

    def flat(own: Particles):
        return jnp.concatenate([own.phases[:, None], own.bins, own.roots[:, 3:], own.roots[:, :3]], 1)

    pairs = jax.vmap(lambda x: jax.vmap(lambda y: model.log_transition(x, y, inputs))(flat(earlier)))(flat(later))
    found = log_transition_matrix(
        log_tables(tables, 0.0), RootWalk(scales, tables.velocities * inputs.seconds, tables.stays), later, earlier
    )
    np.testing.assert_allclose(found, pairs, rtol=2e-5, atol=2e-4)
    without = RootWalk(scales, jnp.zeros((2, 3)), tables.stays)
    assert np.max(np.abs(log_transition_matrix(log_tables(tables, 0.0), without, later, earlier) - pairs)) > 0.1


def test_weights_of_one_step_back():
    rng = np.random.default_rng(1)
    densities, weights, smoothed = rng.random((4, 3)), rng.dirichlet(np.ones(3)), rng.dirichlet(np.ones(4))
    densities[2] = 0.0  # reached from none: says nothing
    reached = densities @ weights
    expected = weights * sum(smoothed[j] * densities[j] / reached[j] for j in (0, 1, 3))
    with np.errstate(divide="ignore"):
        inputs = [jnp.asarray(np.log(x), float) for x in (densities, smoothed, weights)]
    np.testing.assert_allclose(np.exp(reweigh(*inputs)), expected / expected.sum(), rtol=1e-5)


def test_survivors_are_counted_along_the_ancestors():
    ancestors = np.array([[0, 1, 2, 3], [0, 0, 1, 1], [0, 1, 2, 3], [0, 1, 3, 3]])
    nothing = Particles(*(jnp.zeros((4, 4)),) * 3)
    track = Track(jnp.zeros((4, 4, 1)), jnp.zeros((4, 4, 1)), jnp.log(jnp.full((4, 4), 0.25)), ancestors, nothing, None, None)
    np.testing.assert_array_equal(track.survivors(), [2.0])  # 0 and 1 of the first frame
    np.testing.assert_array_equal(track.survivors(1), [2.0, 4.0, 3.0])
    np.testing.assert_allclose(track.ess_share, 1.0, rtol=1e-6)


def test_the_plan_learns_from_what_it_does_not_track():
    recordings = [Recording(name, f"/there/{name}.amc", "/there/a.asf", name) for name in "abcdef"]
    jobs = plan_walks(FULL, recordings)["walks"].jobs
    assert len({job.scene for job in jobs}) == 15 and not any(job.scene.recording.name == "f" for job in jobs)
    learned = [job for job in jobs if job.training is not None]
    assert {job.training.name for job in learned} == {"f"} and all(job.method.name == NAMES[0] for job in learned)
    assert sorted(run for job in learned if job.scene == jobs[0].scene for run in job.runs) == [0, 1]
    assert {kind_of(job.scene.name) for job in learned if job.smoothed} == {"circles", "furniture"}
    assert {kind_of(job.scene.name) for job in jobs if job.smoothed and job.training is None} == {"circles"}
    assert {kind_of(job.scene.name) for job in jobs} == {"circles", "furniture", "announced furniture"}
    assert len({job.key for job in jobs}) == len(jobs)
    assert len({job.scene.folder for job in jobs}) == 10  # the pictures of furniture are the same, announced or not
    assert len({job.scene for job in plan_walks(QUICK, recordings[:2])["walks"].jobs}) == 3
    alone = plan_walks(QUICK, [BUILT_IN])["walks"].jobs
    assert {job.scene.recording for job in alone} == {BUILT_IN} and {job.training for job in alone} == {BUILT_IN, None}
    with pytest.raises(InputError, match="walks"):
        plan_walks(FULL, [BUILT_IN])


def table(gain: float, noise: float = 1.0, ess: float = 0.1, survivors: float = 0.05) -> Table:
    """Smoothers whose errors are lower by a gain on the circles and among the furniture of four people."""
    rng, rows = np.random.default_rng(0), []
    for name in NAMES:
        for scene in (f"{person}-{place}" for person in "abcd" for place in ("clean-circle", "clutter", "clutter-unannounced")):
            for run in range(2):
                for smoother in ("filter", "FBS", "variational", "Gibbs") if scene[2:] != "clutter" else ("filter",):
                    error = 80.0 - (smoother != "filter") * gain + noise * rng.normal()
                    rows.append((scene, 60, name, smoother, run, error, 0.1, ess, survivors))
    return Table("walks", WALK_COLUMNS, rows, "")


def verdicts(table: Table) -> dict[str, str]:
    return {claim.what: claim.verdict for claim in walk_claims({"walks": table})}


def test_scenes_that_were_not_run_are_not_reported():
    circles = [row for row in table(10.0).rows if row[0].endswith("circle")]
    claims = walk_claims({"walks": Table("walks", WALK_COLUMNS, circles, "")})
    assert claims and not any("CLUTTER" in claim.what or "furniture" in claim.what for claim in claims)
    assert not any("nan" in claim.ours for claim in claims)


@pytest.mark.parametrize(("gain", "expected"), [(20.0, "does not hold"), (-20.0, "holds"), (0.0, "holds"), (4.0, "holds")])
def test_gains_are_judged_by_what_matters(gain, expected):
    """8 mm are a tenth of the filter's error; a gain of 4 mm that ten runs tell from none is none."""
    found = verdicts(table(gain))
    assert found["Section 6.2: smoothing does not lower the error of FSHHMM-PF, 1,000"] == expected
    lag = next(verdict for what, verdict in found.items() if "lags behind" in what)
    each = "holds" if expected == "does not hold" else "does not hold"
    assert lag == "; ".join(f"{name} {each}" for name in ("FBS", "variational", "Gibbs"))


def test_intervals_are_over_people():
    """Runs on one person say nothing of others, however many there are."""
    one = [(*row[:4], run, *row[5:]) for row in table(20.0).rows if row[0].startswith("a-") for run in range(9)]
    found = verdicts(Table("walks", WALK_COLUMNS, one, ""))
    assert set(found.values()) == {"undecided", "FBS undecided; variational undecided; Gibbs undecided"} | {
        "none: other recordings",
        "none: another machine",
    }


def test_furniture_that_adds_to_generic_motions_alone():
    rows = [
        (*row[:5], row[5] * (2 if "unannounced" in row[0] and row[2] == NAMES[1] else 1), *row[6:]) for row in table(0.0).rows
    ]
    found = verdicts(Table("walks", WALK_COLUMNS, rows, ""))
    what = "Section 6.1: clutter adds more to the error of Simple-PF, 1,000 than to that of FSHHMM-PF, 1,000"
    assert found[what] == "holds" and verdicts(table(0.0))[what] == "does not hold"


@pytest.mark.parametrize(("ess", "expected"), [(0.1, "holds"), (0.4, "does not hold"), (0.01, "does not hold")])
def test_verdicts_follow_the_effective_sample_size(ess, expected):
    assert verdicts(table(0.0, ess=ess))["The effective sample size of FSHHMM-PF, as a share of N"] == expected


@pytest.mark.parametrize(("share", "expected"), [(0.001, "holds"), (0.05, "does not hold")])
def test_verdicts_follow_the_ancestors(share, expected):
    found = verdicts(table(0.0, survivors=share))
    assert next(verdict for what, verdict in found.items() if "descendants" in what) == expected


@pytest.mark.full
def test_the_page_tells_gains():
    told = walks({"walks": table(10.0, noise=0.0)})
    assert "| FSHHMM-PF, 1,000 | FBS | 70 (70 to 70) | 12 (12 to 12) | 70 (70 to 70) | 12 (12 to 12) |  | 0.1 |" in told
    assert "| FSHHMM-PF, 1,000 | filter | 80 (80 to 80) |  | 80 (80 to 80) |  | 80 (80 to 80) | 0.1 |" in told
    assert walks({}) == ""
