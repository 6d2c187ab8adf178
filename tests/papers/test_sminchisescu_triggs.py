"""Tracks of Sminchisescu and Triggs 2001: when a body is lost, what tables say of it, and a run that ends early."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from poseppl_papers.experiment import FAILS, HOLDS, UNDECIDED, on_one_recording
from poseppl_papers.measured import mean_interval
from poseppl_papers.page import page_of
from poseppl_papers.recordings import BUILT_IN
from poseppl_papers.sminchisescu_triggs import EXPERIMENT
from poseppl_papers.sminchisescu_triggs.claims import BODIES_ARE, claims
from poseppl_papers.sminchisescu_triggs.motions import MOTIONS, PROGRAMS, moving
from poseppl_papers.sminchisescu_triggs.plan import FULL, QUICK, plan_arm, plan_complex, plan_pivot, plan_reflections
from poseppl_papers.sminchisescu_triggs.spectra import log_volume_ratio
from poseppl_papers.sminchisescu_triggs.survival import COLUMNS, LOST, kept_seconds, losses, lost_at, percent_lost
from poseppl_papers.sminchisescu_triggs.trackers import PUBLISHED, TRACKERS
from poseppl_papers.sminchisescu_triggs.tracks import Tracks, scene_of, track
from poseppl_papers.tables import Table, read_folder
from scipy import stats

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "sminchisescu-triggs-2001"


def test_a_body_is_lost_where_it_stays_lost():
    """Five frames of 25 a second make 0.2 s; four do not, and what comes after is not asked."""
    errors = np.full(40, LOST - 1)
    errors[3:7] = LOST + 1
    assert lost_at(errors, 25.0) == np.inf
    errors[20:25] = LOST + 1
    assert lost_at(errors, 25.0) == 20 / 25
    assert lost_at(errors[:24], 25.0) == np.inf and lost_at(np.full(3, 2 * LOST), 25.0) == np.inf


def test_intervals():
    """Wilson's by its formula, Student's against scipy's."""
    count, runs, z = 3, 12, stats.norm.ppf(0.975)
    share = count / runs
    middle = (share + z**2 / (2 * runs)) / (1 + z**2 / runs)
    half = z / (1 + z**2 / runs) * np.sqrt(share * (1 - share) / runs + z**2 / (4 * runs**2))
    lost = np.where(np.arange(runs) < count, 0.4, np.inf)
    np.testing.assert_allclose(percent_lost(lost), np.multiply(100, (share, middle - half, middle + half)), rtol=1e-9)
    values = np.array([1.0, 2.0, 4.0, 4.5])
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    np.testing.assert_allclose(mean_interval(values), (values.mean(), expected.low, expected.high), rtol=1e-9)
    assert mean_interval(np.array([2.0]))[1:] == (-np.inf, np.inf)
    np.testing.assert_equal(mean_interval([]), (np.nan, -np.inf, np.inf))
    np.testing.assert_array_equal(kept_seconds(np.array([0.4, np.inf]), 1.2), [0.4, 1.2])


def table_of(name, lost, ratio=1000.0, length=1.2):
    """A table by hand: seconds at which each tracker loses the body, by run."""
    rows = [
        (name, name, 25.0, "cluttered", length, tracker, seed, float(when), 50.0, ratio, 2.0, 0.1)
        for tracker, times in lost.items()
        for seed, when in enumerate(times)
    ]
    return {name: Table(name, COLUMNS, rows)}


NEVER, EARLY = [np.inf] * 12, [0.3 + 0.02 * run for run in range(12)]


def verdicts(tables):
    return {claim.what: claim.verdict for claim in claims(tables)}


def test_verdicts_of_tables_by_hand():
    """Tracks that are lost at once, and never; halves decide nothing, nor do few runs."""
    found = verdicts(table_of("pivot", {PUBLISHED: NEVER, "robust, single mode": EARLY, "MHT, robust": NEVER}))
    assert found["pivoting body: lost by robust, single mode"] == HOLDS
    assert found["pivoting body: lost by MHT, robust"] == FAILS
    kept = f"pivoting body, cluttered room: kept to the end by {PUBLISHED} sampling"
    longer = f"pivoting body: {PUBLISHED} sampling keeps the body longer than "
    assert found[kept] == HOLDS
    assert found[longer + "robust, single mode"] == on_one_recording(HOLDS)
    assert found[longer + "MHT, robust"] == on_one_recording(FAILS)  # both keep it: no difference that matters
    worse = verdicts(table_of("pivot", {PUBLISHED: EARLY, "robust, single mode": NEVER}))
    assert worse[kept] == FAILS and worse[longer + "robust, single mode"] == on_one_recording(FAILS)
    half = verdicts(table_of("pivot", {PUBLISHED: NEVER[:6] + EARLY[:6]}))
    assert half[kept] == UNDECIDED
    few = verdicts(table_of("pivot", {PUBLISHED: NEVER[:9]}))
    assert few[kept] == "no verdict from 9 runs"


def test_runs_of_a_motion_are_one_of_it():
    """The published tracker keeps the body in one of three motions alone: 36 pairs of runs decide nothing."""
    rows = []
    for motion, times in (("punch", NEVER), ("bend", EARLY), ("jump", EARLY)):
        made = table_of("complex", {PUBLISHED: times, "robust, single mode": EARLY})["complex"]
        rows += [
            tuple(motion if name == "motion" else value for name, value in zip(COLUMNS, row, strict=True)) for row in made.rows
        ]
    found = verdicts({"complex": Table("complex", COLUMNS, rows)})
    assert found[f"complex motions: {PUBLISHED} sampling keeps the body longer than robust, single mode"] == UNDECIDED


def test_verdicts_of_numbers():
    """More modes that keep the body a tenth longer would be needed."""
    more = f"{PUBLISHED}, twice as many"
    name = "pivoting body: 7 modes x 6 directions suffice"
    assert verdicts(table_of("pivot", {PUBLISHED: NEVER, more: NEVER}))[name] == HOLDS
    assert verdicts(table_of("pivot", {PUBLISHED: EARLY, more: NEVER}))[name] == FAILS


def spectra_by_hand(sd):
    """Twelve poses of the arm and of a body with equal spectra."""
    rows = [
        (kind, len(sd), pose, rank, float(value))
        for kind in ("arm", "full")
        for pose in range(12)
        for rank, value in enumerate(sd, 1)
    ]
    return {"spectra": Table("spectra", ("body", "coordinates", "pose", "rank", "sd"), rows)}


def test_verdicts_of_spectra():
    """Ratios within a factor of three; volumes by the product over axes of sqrt(sd^2 + 3 widest^2) / (2 sd)."""
    of = "Largest over smallest standard deviation of a mode, 8 coordinates (Fig. 3)"
    for ratio, verdict in ((350.0, HOLDS), (100.0, FAILS), (1100.0, FAILS)):
        assert verdicts(spectra_by_hand([1.0, 1 / ratio]))[of] == verdict
    assert log_volume_ratio(np.array([2.0, 1.0])) == pytest.approx(np.log10(13**0.5 / 2))
    assert log_volume_ratio(np.full((3, 5), 0.7)) == pytest.approx(np.zeros(3))  # all axes are alike
    volume = "Section 1.1: how many times larger the search volume of uniform noise is that doubles the largest radius"
    many = np.r_[1.0, np.full(31, 3**0.5 / 2 * 10 ** (-54 / 31))]
    assert verdicts(spectra_by_hand(many))[volume] == HOLDS
    assert verdicts(spectra_by_hand(many[:20]))[volume] == FAILS


def test_shares_lost_are_over_motions():
    """Two motions of six runs, one lost always and one never: 50 %, of which two motions say nothing; by runs 25 to 75 %."""
    lost, motions = np.array(EARLY[:6] + NEVER[:6]), ["kick"] * 6 + ["bow"] * 6
    assert percent_lost(lost, motions) == (50.0, 0.0, 100.0)
    assert percent_lost(lost, map(str, range(12))) == percent_lost(lost) and percent_lost(lost).low > 20


def test_a_summary_of_losses():
    row = losses(table_of("pivot", {PUBLISHED: NEVER[:6] + [0.6] * 6})["pivot"])[0]
    assert row[2:4] == (PUBLISHED, 12) and row[4].startswith("50 % (25 to 75)") and row[5].startswith("0.90 of 1.2 s")


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "kind"),
    [("arm", "arm"), ("pivot", "stiff_shoulders"), ("turns", "full"), *((name, "stiff_shoulders") for name in MOTIONS)],
)
def test_own_motions_keep_to_the_limits(scene, kind):
    """And differ from seed to seed."""
    made = [moving(scene, kind, BUILT_IN, 25.0, 2.0, seed) for seed in range(2)]
    low, high = made[0].body.limits.T
    limited = np.isfinite(low)
    for each in made:
        assert each.states.shape == (50, len(low)) and each.markers.shape[0] == 50
        assert (each.states[:, limited] >= low[limited]).all() and (each.states[:, limited] <= high[limited]).all()
    assert np.abs(made[0].states - made[1].states).max() > 0.1 and scene in PROGRAMS


@pytest.mark.full
def test_limbs_swing_along_the_optical_axis():
    """The hand or foot that moves most does so along the view, by more than 150 mm."""
    for name in MOTIONS:
        job = Tracks(name, "stiff_shoulders", BUILT_IN, 25.0, 2.0, False, PUBLISHED, (0,), along=True)
        scene = scene_of(job, 0)
        names = list(scene.motion.body.tree.marker_names)
        ends = scene.motion.markers[:, [names.index(f"{end}_{side}") for end in ("wrist", "ankle") for side in "lr"]]
        places = ends - scene.motion.markers[:, :1]
        most = np.ptp(places, axis=0).max(1).argmax()
        way = places[:, most] - places[:, most].mean(0)
        direction = np.linalg.svd(way[:, :2])[2][0]
        eye, middle = np.asarray(scene.camera.centre)[0], np.median(scene.motion.markers.reshape(-1, 3), axis=0)
        view = (middle - eye)[:2] / np.linalg.norm((middle - eye)[:2])
        assert abs(view @ direction) > 0.8 and np.ptp(way @ np.append(view, 0.0)) > 150, name


@pytest.mark.full
def test_points_go_astray_in_clutter_alone():
    jobs = [Tracks("arm", "arm", BUILT_IN, 25.0, 2.0, cluttered, PUBLISHED, (0,)) for cluttered in (False, True)]
    black, cluttered = (scene_of(job, 0).points for job in jobs)
    far = np.abs(cluttered - black).max(-1) > 1e-6
    assert 0.04 < far.mean() < 0.18  # a tenth of 200


def test_every_part_has_its_jobs():
    for plan in (plan_arm, plan_pivot, plan_complex):
        for scale in (FULL, QUICK):
            jobs = plan(scale, (BUILT_IN,))["tracks"].jobs
            assert len({job.key for job in jobs}) == len(jobs)
            assert {job.tracker for job in jobs} >= {PUBLISHED, "Gaussian, single mode"} <= set(TRACKERS)
            seeds = [seed for job in jobs if job.tracker == PUBLISHED and job.rate == 25.0 for seed in job.seeds]
            assert sorted(seeds) == list(range(scale.more_runs if plan is plan_complex else scale.runs))


def test_every_motion_has_as_many_runs():
    jobs = [job for job in plan_reflections(FULL, (BUILT_IN,))["tracks"].jobs if job.tracker == PUBLISHED]
    assert [job.scene for job in jobs] == list(MOTIONS) and {len(job.seeds) for job in jobs} == {2}
    assert sorted(seed for job in jobs for seed in job.seeds) == list(range(2 * len(MOTIONS)))
    assert all(job.apart and job.along for job in jobs)


@pytest.mark.slow  # a minute to compile
def test_an_arm_is_lost_by_a_gaussian_tracker_and_kept_by_the_published_one():
    found = {
        tracker: track(Tracks("arm", "arm", BUILT_IN, 25.0, 8.0, True, tracker, (0, 1)))
        for tracker in (PUBLISHED, "Gaussian, single mode")
    }
    assert np.isinf(found[PUBLISHED]["lost"]).all() and (found[PUBLISHED]["error"] < 60).all()
    assert np.isfinite(found["Gaussian, single mode"]["lost"]).all()
    assert (found[PUBLISHED]["ratio"] > 10).all()


@pytest.mark.full
def test_the_committed_page_says_what_its_tables_say():
    assert page_of(EXPERIMENT, FOLDER) == (FOLDER / "page.md").read_text(encoding="utf-8")
    kept = read_folder(FOLDER)
    assert {f"{name}.csv" for name in kept} == {path.name for path in FOLDER.glob("*.csv")} and kept
    named = {name for each in kept.values() if "tracker" in each.table.columns for name in each.table.column("tracker")}
    assert named <= {*TRACKERS, *BODIES_ARE.values()}


@pytest.mark.full
def test_another_number_in_a_table_is_another_page(tmp_path):
    """A run that kept the arm to the end, made one that lost it."""
    for path in FOLDER.iterdir():
        shutil.copy(path, tmp_path / path.name)
    text = (tmp_path / "arm.csv").read_text(encoding="utf-8")
    assert ",inf," in text
    (tmp_path / "arm.csv").write_text(text.replace(",inf,", ",0.5,", 1), encoding="utf-8")
    assert page_of(EXPERIMENT, tmp_path) != page_of(EXPERIMENT, FOLDER)
