"""Section 7.2 and Table 4: the animated body, its errors, one camera's start, and the verdicts of tables made by hand."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.peursum.body import peursum_body
from poseppl_models.peursum.factored_system import check_limits
from poseppl_papers.peursum.claims import claims
from poseppl_papers.peursum.factored_draws import log_walk_matrix
from poseppl_papers.peursum.monocular import COLUMNS, GROUND, THEIRS, _hues, draw_body, monocular, monocular_claims
from poseppl_papers.peursum.plan import FULL, LEARNED, PUBLISHED, plan_monocular, plan_runtimes
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS, STAGES
from poseppl_papers.peursum.tables import RUNTIME_COLUMNS as TIMED, runtime_claims, runtime_table, runtimes
from poseppl_papers.peursum.tracks import posture_squares
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table

from poseppl.errors import InputError
from poseppl.motion.geometry import Cameras, marker_positions
from poseppl.motion.learned import FactoredTables, bin_angles, root_places
from poseppl.motion.tracking.marker_errors import virtual_markers
from poseppl.motion.tracking.placing import cameras_of_records, place_cameras, records_of_cameras

BODY = peursum_body()
NAMES = ("Simple-PF, 10,000", "FSHHMM-PF, 1,000")
SIZE = 96, 72


def behind_whom(view: float) -> Cameras:
    path = np.array([[0.0, 0.0, 900.0], [0.0, 400.0, 900.0]])
    return cameras_of_records(records_of_cameras(place_cameras(path, 0.0, view=view), 120.0, SIZE))


@pytest.mark.full
def test_near_parts_hide_far_ones():
    hues = dict(zip(BODY.flesh.names, _hues(len(BODY.flesh.names)), strict=True))
    for view, near, far in ((90.0, "upper_arm_r", "upper_arm_l"), (-90.0, "upper_arm_l", "upper_arm_r")):
        (image,) = draw_body(BODY, BODY.rest[None], behind_whom(view), SIZE)
        pixels = {name: np.all(image == hue, axis=-1).sum() for name, hue in hues.items()}
        assert pixels[near] > 10 > pixels[far] and pixels["torso"] > 50  # the trunk hides the far arm, and not the near one
        assert np.all(image == GROUND, axis=-1).sum() > 0.8 * np.prod(SIZE)


def test_tables_beyond_the_bodys_limits_are_refused():
    places = root_places(BODY.tree.coordinates)
    rest = np.delete(BODY.rest, places)
    angles = np.asarray(bin_angles(np.arange(120), 120))
    nearest = np.argmin(np.abs(angles - np.clip(rest, *np.delete(BODY.limits, places, 0).T)[:, None]), 1)
    # two phases: a rotation may be beyond in one of them
    entries = np.eye(120)[np.stack([nearest, np.full_like(nearest, 119)])]
    tables = FactoredTables(*(jnp.zeros(1),) * 3, jnp.asarray(entries), *(jnp.zeros(1),) * 3)
    check_limits(BODY, tables, "walk.nc")
    names = [name for number, name in enumerate(BODY.tree.coordinate_names) if number not in places]
    entries[0, names.index("hip_l.Z")] = entries[1, 0]
    with pytest.raises(InputError, match=r"hip_l\.Z of the learned walk is beyond"):
        check_limits(BODY, tables._replace(entries=jnp.asarray(entries)), "walk.nc")


def test_relative_errors_put_the_pelvises_together():
    states = BODY.rest[None] + np.eye(1, len(BODY.rest)) * [300.0]
    truth = virtual_markers(BODY.tree.marker_names, marker_positions(BODY.tree, jnp.asarray(BODY.rest, float)))
    absolute, relative = posture_squares(BODY.tree, states, [1.0], truth)
    assert absolute == pytest.approx(300.0**2, rel=1e-4) and relative == pytest.approx(0.0, abs=1e-3)
    truth = np.array(truth)
    truth[2] += [0.0, 60.0, 0.0]
    np.testing.assert_allclose(posture_squares(BODY.tree, BODY.rest[None], [1.0], truth), 60.0**2 / 15, rtol=1e-4)


def test_densities_of_a_walk_are_those_of_its_steps():
    rng = np.random.default_rng(0)
    scales = rng.uniform(0.1, 20.0, 28)
    earlier = 3000 + rng.normal(size=(6, 28)) * scales
    later = earlier[:5] + 2 * rng.normal(size=(5, 28)) * scales
    found = np.asarray(log_walk_matrix(*(jnp.asarray(each, float) for each in (scales, later, earlier))))
    expected = -0.5 * np.square((later[:, None] - earlier[None]) / scales).sum(-1)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-2)


def test_the_plans_are_the_papers():
    recordings = [Recording(name, f"/there/{name}.amc", "/there/a.asf", name) for name in "ab"]
    jobs = plan_monocular(FULL, recordings)["monocular"].jobs
    plain_jobs = [job for job in jobs if "lambda" not in job.method.name]
    assert {(job.method.name, job.system.name, job.rounds) for job in plain_jobs} == {
        (NAMES[0], PUBLISHED.name, 5_000),
        ("Simple-PF, 1,000", PUBLISHED.name, 5_000),
        (NAMES[1], LEARNED.name, 2_000),
        ("FSHHMM-PF of 25 Hz, 1,000", LEARNED.name, 2_000),
    }
    assert {job.training_rate for job in jobs if job.method.name == NAMES[1]} == {50.0}
    sharper = {
        job.method.name.partition(",")[0]: dict(job.system.settings)["exponent"] for job in jobs if job not in plain_jobs
    }
    assert sharper == {"Simple-PF": 40.0, "FSHHMM-PF": 32.0, "FSHHMM-PF of 25 Hz": 32.0}
    assert all(job.system.views == 1 and job.scene.rate == 25.0 for job in jobs)
    assert all(job.training in (None, job.scene.recording) for job in jobs) and len({job.key for job in jobs}) == len(jobs)
    assert [job.scene.recording.name for job in jobs] == ["a"] * 8 + ["b"] * 8 and {job.runs for job in jobs} == {(0, 1)}
    timed = plan_runtimes(FULL, recordings)["runtimes"].jobs
    assert {job.method.name for job in timed} == {*NAMES, "Simple-APF, 10 x 1,000"} and len(timed) == 6


def table(gain: float, learned: float = 50.0) -> Table:
    """Two runs of both filters on six walks, whose smoothers take some mm away."""
    rng, rows = np.random.default_rng(1), []
    for name, error in zip(NAMES, (110.0, learned), strict=True):
        for scene, run in itertools.product("abcdef", range(2)):
            for smoother in ALGORITHMS:
                own = error - (smoother != "filter") * gain + rng.normal()
                rows.append((f"{scene}-animated", 60, name, smoother, run, own, 2 * own, 0.1))
    return Table("monocular", COLUMNS, rows, "")


@pytest.mark.parametrize(
    ("gain", "generic", "learned"),
    [(20.0, "000", "100"), (-20.0, "000", "000"), (0.0, "111", "011"), (-2.0, "111", "011"), (11.0, "???", "100")],
)
def test_smoothers_are_judged_by_what_matters(gain, generic, learned):
    """Only one of the six published gains, FBS after the learned motion, 12 %, exceeds the tenth that matters."""
    words = {"holds": "1", "does not hold": "0", "undecided": "?"}
    found = {claim.what: claim.verdict for claim in monocular_claims({"monocular": table(gain)})}
    for name, expected in zip(NAMES, (generic, learned), strict=True):
        verdict = next(each for what, each in found.items() if what.startswith("Table 3: what") and name in what)
        assert "".join(words[part.split(" ", 1)[1]] for part in verdict.split("; ")) == expected


@pytest.mark.parametrize(("error", "expected"), [(40.0, "holds"), (80.0, "does not hold"), (64.6, "undecided")])
def test_the_learned_motion_halves_the_error(error, expected):
    *_, last = monocular_claims({"monocular": table(0.0, error)})
    assert last.verdict == expected


def test_the_page_tells_published_errors_beside_ours():
    told = monocular({"monocular": table(10.0)}).splitlines()
    assert len(told) == 2 + 8 and told[2].startswith("| Simple-PF, 10,000 | filter | 111.1 | 1")
    assert all(f"| {value:g} |" in told[6 + number] for number, value in enumerate(THEIRS["FSHHMM-PF"]))
    assert monocular({}) == runtimes({}) == "" and claims({}) == []


class Timed:
    """A job as far as its table goes."""

    def __init__(self, scene: str, method: str) -> None:
        self.scene, self.method = Named(scene), Named(method)
        self.runs, self.num_frames, self.key = (0, 1), 12, f"{scene}-{method}"


class Named:
    """Something with a name."""

    def __init__(self, name: str) -> None:
        self.name = name


def test_seconds_leave_the_run_that_compiles_out():
    jobs = [Timed("a-clean-circle1200", NAMES[0]), Timed("a-clutter", NAMES[0])]
    stages = np.array([[99.0] * 5, [2.0, 1.0, 0.5, 0.25, 4.0]])
    results: Mapping[str, Mapping[str, object]] = {job.key: {"stages": stages} for job in jobs}
    (made,) = runtime_table({"runtimes": jobs}, results)
    assert made.columns == TIMED and len(made.rows) == 2 * len(STAGES) and 99.0 not in made.column("seconds")
    assert "| circle | Simple-PF, 10,000 | 2 (240) | 1 (138) | 0.5 (30) | 0.25 (40) | 4 (200) |" in runtimes({"runtimes": made})
    (claim,) = runtime_claims({"runtimes": made})
    assert claim.ours == "Simple-PF, 10,000 50, 38, 225" and claim.theirs == "Simple-PF, 10,000 58, 29, 96"


def test_runs_on_one_walk_decide_nothing():
    one = [(*row[:4], run, *row[5:]) for row in table(20.0).rows if row[0].startswith("a-") for run in range(9)]
    found = monocular_claims({"monocular": Table("monocular", COLUMNS, one, "")})
    assert {part.split(" ")[-1] for claim in found for part in claim.verdict.split("; ")} == {"undecided"}
