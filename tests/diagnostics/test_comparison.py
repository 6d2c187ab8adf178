"""Comparisons against their definitions, ArviZ, and answers that are known."""

from __future__ import annotations

import json

import arviz_stats
import numpy as np
import pytest
import xarray as xr
from same_data import DOFS, run_on, scene

from poseppl.diagnostics import compare, comparison_table
from poseppl.diagnostics.batches import CONFIDENCE, log_ratio, mean_interval
from poseppl.diagnostics.paired_comparison import MIN_COVERAGE, TIE, compare_losses
from poseppl.diagnostics.replicates import variance_against_time
from poseppl.diagnostics.verdicts.comparison import findings
from poseppl.errors import InputError

DATA = scene()


@pytest.fixture(scope="module")
def runs() -> dict[str, xr.DataTree]:
    return {
        "slow": run_on(DATA, rho=0.8, seed=1),
        "quick": run_on(DATA, rho=0.0, seed=2, seconds=0.05),
        "weighted": run_on(DATA, method="particle", weighted=40.0, evaluations=(1000, 0), seed=3),
        "kalman": run_on(DATA, method="kalman", weighted=1000.0, evaluations=(1, 1), seed=4),
    }


@pytest.fixture(scope="module")
def comparison(runs: dict[str, xr.DataTree]) -> xr.DataTree:
    return compare(runs)


def test_figures_are_their_definitions(runs: dict[str, xr.DataTree], comparison: xr.DataTree) -> None:
    figures = comparison["figures"].dataset
    for name in ("slow", "quick"):
        found, stats = figures.sel(run=name), runs[name]
        effective = arviz_stats.ess(stats, var_names=["state"], method="mean")["state"].values
        np.testing.assert_allclose(found["ess"], effective, rtol=1e-6)
        np.testing.assert_allclose(found["tau"], 200 / effective, rtol=1e-6)
        np.testing.assert_allclose(found["ess_per_second"], effective / (0.1 if name == "slow" else 0.05), rtol=1e-6)
        np.testing.assert_allclose(found["ess_per_evaluation"], effective / 400, rtol=1e-6)
        rhat = arviz_stats.rhat(stats, var_names=["state"], method="split")["state"].values
        np.testing.assert_allclose(found["rhat"], rhat, rtol=1e-6)
        np.testing.assert_allclose(found["rejection"], 0.2)
        mean = stats["unconstrained_posterior/state"].values.mean(axis=(0, 1))
        error = np.abs(mean - DATA["state"])
        np.testing.assert_allclose(found["error"], error, rtol=1e-9)
        spread = stats["unconstrained_posterior/state"].values.reshape(200, *mean.shape).std(axis=0, ddof=1)
        np.testing.assert_allclose(found["error_over_sd"], error / spread, rtol=1e-9)
        distance = 100 * np.sqrt(3) * np.abs(mean - DATA["state"]).mean(axis=1)
        np.testing.assert_allclose(found["joint_error"], distance, rtol=1e-9)
        relative = 100 * np.sqrt(3) * np.abs((mean - DATA["state"]) - (mean - DATA["state"])[:, :1]).mean(axis=1)
        np.testing.assert_allclose(found["joint_error_relative"], relative, rtol=1e-9)


def test_particles_have_no_rhat_and_closed_forms_no_ess(comparison: xr.DataTree) -> None:
    figures = comparison["figures"].dataset
    weighted, kalman = figures.sel(run="weighted"), figures.sel(run="kalman")
    np.testing.assert_allclose(weighted["tau"], 1000 / 40)
    np.testing.assert_allclose(weighted["ess_per_evaluation"], 40 / 1000)
    assert np.isnan(weighted["rhat"]).all() and np.isnan(weighted["rejection"]).all()
    for name in ("tau", "ess", "ess_per_second", "ess_per_evaluation", "rhat", "rejection"):
        assert np.isnan(kalman[name]).all()
    assert np.isfinite(kalman["error"]).all() and np.isfinite(kalman["joint_error"]).all()
    assert figures["kind"].values.tolist() == ["chains", "chains", "weighted particles", "closed form"]
    for name in ("winner", "winner_by_state_dim"):
        ratio = comparison[name].dataset.sel(run="kalman", quantity=["ess_per_second", "ess_per_evaluation"])
        assert not ratio["not_worse"].any() and np.isnan(ratio["ratio"]).all()


def test_a_kalman_filter_without_a_name_is_known_by_its_evaluations() -> None:
    tree = run_on(DATA, weighted=200.0, evaluations=(1, 1), method="my own")
    assert compare({"a": tree, "b": run_on(DATA)})["figures/kind"].values.tolist() == ["closed form", "chains"]


def test_summaries_are_means_over_frames(comparison: xr.DataTree) -> None:
    figures, summary = comparison["figures"].dataset.sel(run="slow"), comparison["summary"].dataset.sel(run="slow")
    np.testing.assert_allclose(summary["tau"], figures["tau"].mean("frame"))
    np.testing.assert_allclose(summary["ess"], 200 / figures["tau"].mean("frame"))
    np.testing.assert_allclose(summary["ess_per_second_all"], 2000 / figures["tau"].mean())
    np.testing.assert_allclose(summary["rhat"], figures["rhat"].max("frame"))
    np.testing.assert_allclose(summary["error_over_sd"], figures["error_over_sd"].median("frame"))
    np.testing.assert_allclose(summary["tau_all"], figures["tau"].mean(("frame", "state_dim")))
    np.testing.assert_allclose(summary["tau_median_all"], figures["tau"].median(("frame", "state_dim")))
    inside = figures["inside"].mean(("frame", "state_dim"))
    np.testing.assert_allclose(summary["coverage_all"], inside)
    assert (np.abs(summary["coverage_all"] - summary["level"]) < 5 * summary["coverage_se_all"]).all()
    assert (np.abs(summary["coverage"] - summary["level"]) < 5 * summary["coverage_se"]).all()


def test_the_quicker_run_wins_by_the_known_factor() -> None:
    """The chains' inefficiencies are (1 + rho) / (1 - rho) = 3 and 1, and the times 2 to 1."""
    long = {
        "slow": run_on(DATA, rho=0.5, seed=1, shape=(4, 1500)),
        "quick": run_on(DATA, seed=2, seconds=0.05, shape=(4, 1500)),
    }
    result = compare(long)
    outcome = result["winner"].dataset.sel(quantity="ess_per_second", run="slow")
    assert result["winner"]["winner"].sel(quantity="ess_per_second").item() == "quick"
    assert (result["winner_by_state_dim"]["winner"].sel(quantity="ess_per_second") == "quick").all()
    reach = float(np.log(outcome["ratio_high"] / outcome["ratio"])) - np.log(1.1)
    assert 0 < reach < 0.1
    assert abs(float(np.log(6 * outcome["ratio"]))) < reach + 0.03, "and 3 % for the bias of ArviZ's estimate at this length"
    assert result["winner"]["winner"].sel(quantity="error").item() == TIE


def test_the_smaller_error_wins_in_all_and_in_every_coordinate() -> None:
    result = compare({"near": run_on(DATA, seed=1), "far": run_on(DATA, seed=2, shift=5.0)})
    assert result["winner"]["winner"].sel(quantity="error").item() == "near"
    assert (result["winner_by_state_dim"]["winner"].sel(quantity="error") == "near").all()


def test_equal_runs_tie_and_are_called_so() -> None:
    result = compare({name: run_on(DATA, seed=seed, rho=0.3) for seed, name in enumerate(("a", "b", "c"))})
    assert result["winner"]["winner"].values.tolist() == [TIE, TIE, TIE]
    assert result["winner"]["not_worse"].all()


def test_intervals_of_a_ratio_cover_it_as_often_as_they_say() -> None:
    """Over ten frames there are three batches: Student's factor is needed, and the normal one would cover too little."""
    rng = np.random.default_rng(0)
    trials = 2000
    hits = np.zeros(2)
    for _ in range(trials):
        a, b = np.exp(0.1 * rng.standard_normal((2, 10)))
        found = log_ratio(a, b)
        hits += np.abs(found.estimate) <= np.array([found.half_width, 1.96 * found.standard_error])
    share, error = hits / trials, np.sqrt(CONFIDENCE * (1 - CONFIDENCE) / trials)
    assert abs(share[0] - CONFIDENCE) < 5 * error
    assert share[1] < CONFIDENCE - 5 * error


def test_batches_know_of_correlation_over_frames() -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((400, 400))
    walk = np.empty_like(noise)
    walk[0] = noise[0]
    for t in range(1, len(noise)):
        walk[t] = 0.6 * walk[t - 1] + 0.8 * noise[t]
    found = [mean_interval(walk[:, i]) for i in range(walk.shape[1])]
    true = np.std([interval.estimate for interval in found])
    mean = np.mean([interval.standard_error for interval in found])
    naive = np.mean(walk.std(axis=0)) / np.sqrt(len(walk))
    assert abs(mean / true - 1) < 0.15, "twenty batches of twenty frames leave a bias of some 8 %"
    assert naive / true < 0.6


def test_runs_without_a_figure_do_not_take_part() -> None:
    losses = np.full((3, 20), 1.0) * np.array([[1.0], [2.0], [0.5]])
    losses[2] = np.nan
    outcome = compare_losses(losses)
    assert outcome.not_worse.tolist() == [True, False, False] and np.isnan(outcome.ratio[2])
    np.testing.assert_allclose(outcome.ratio[:2], [1, 0.5])
    losses[1] = np.nan
    assert not compare_losses(losses).not_worse.any(), "nobody wins against nobody"
    assert compare_losses(np.array([[1.0], [5.0]])).not_worse.all(), "one frame cannot tell"
    assert compare_losses(np.array([[1.0] * 9, [1.05] * 9]), noise=0.1).not_worse.all(), "within the noise of timing"
    assert not compare_losses(np.array([[1.0] * 9, [1.15] * 9]), noise=0.1).not_worse[1]


def test_a_wrong_posterior_is_left_out_of_comparisons_of_ess() -> None:
    result = compare({"wrong": run_on(DATA, shift=5.0, seconds=0.001), "a": run_on(DATA, seed=1), "b": run_on(DATA, rho=0.8)})
    assert result["summary"]["miscalibrated"].values.tolist() == [True, False, False]
    assert result["summary"]["coverage_all"].sel(run="wrong", level=0.9) < MIN_COVERAGE
    assert result["winner"]["winner"].sel(quantity="ess_per_second").item() == "a"
    assert not result["winner"]["not_worse"].sel(quantity="error", run="wrong")


def test_variance_between_seeds_is_that_of_the_mean() -> None:
    """Independent draws of unit variance: the mean of 200 of them has the variance 1 / 200, within and between runs."""
    trees = {f"seed {seed}": run_on(DATA, seed=seed) for seed in range(8)}
    points = compare(trees | {"lone": run_on(DATA, seed=20, shape=(4, 20))})["variance"].dataset
    assert points["replicates"].values.tolist() == [8, 1]
    assert points["setting"].values.tolist() == ["seed 0", "lone"]
    estimate, error = float(points["variance"][0]), float(points["variance_se"][0])
    cells = 7 * DATA["state"].size
    assert 0.5 * np.sqrt(2 / cells) < error / estimate < 2 * np.sqrt(2 / cells)
    assert abs(estimate - 1 / 200) < 5 * error
    np.testing.assert_allclose(points["variance_by_state_dim"].mean("state_dim"), points["variance"])
    assert abs(float(points["variance"][1]) - 1 / 80) < 0.25 / 80, "its own estimate, from short chains"
    np.testing.assert_allclose(points["seconds"], 0.1)
    pair = compare({"a": run_on(DATA, seed=0), "b": run_on(DATA, seed=1)})["variance"].dataset
    np.testing.assert_allclose(pair["variance_se"], np.sqrt(2) * pair["variance"])


def test_the_error_of_a_variance_between_seeds_is_the_jackknifes() -> None:
    """By leaving each of five seeds out and computing the sample variance of the other four."""
    means = np.random.default_rng(3).normal(size=(5, 4, 2))
    sd = np.array([0.5, 3.0])
    figures = xr.Dataset(
        {
            "mean": (("run", "frame", "state_dim"), means),
            "sd": (("run", "frame", "state_dim"), np.broadcast_to(sd, means.shape)),
            "ess": (("run", "frame", "state_dim"), np.ones(means.shape)),
            "seconds": ("run", np.array([1.0, 2.0, 1.0, 3.0, 3.0])),
            "method": ("run", ["particle"] * 5),
            "setting": ("run", ["one"] * 5),
            "seed": ("run", list("01234")),
        },
        {"run": list("abcde"), "state_dim": ["x", "y"]},
    )
    found = variance_against_time(figures)
    each = (means.var(0, ddof=1) / sd**2).mean(0)
    left = np.stack([(np.delete(means, seed, 0).var(0, ddof=1) / sd**2).mean(0) for seed in range(5)])
    np.testing.assert_allclose(found["variance_by_state_dim"][0], each)
    np.testing.assert_allclose(found["variance"][0], each.mean())
    np.testing.assert_allclose(found["variance_by_state_dim_se"][0], np.sqrt(4 * left.var(0)))
    np.testing.assert_allclose(found["variance_se"][0], np.sqrt(4 * left.mean(1).var()))
    np.testing.assert_allclose([found["seconds"][0], found["seconds_se"][0]], [2.0, np.sqrt(1.0 / 5)])


def test_a_seed_counts_once() -> None:
    points = compare({"a": run_on(DATA, seed=5), "a again": run_on(DATA, seed=5)})["variance"].dataset
    assert points["replicates"].values.tolist() == [1]


def test_the_table_is_the_tree(comparison: xr.DataTree) -> None:
    rows = comparison_table(comparison)
    assert len(rows) == 4 * 40 * 3
    figures = comparison["figures"].dataset
    row = next(row for row in rows if (row["run"], row["frame"], row["state_dim"]) == ("slow", 7, DOFS[2]))
    cell = figures.sel(run="slow", frame=7, state_dim=DOFS[2])
    for name in ("tau", "ess_per_second", "error", "rejection", "joint_error"):
        assert row[name] == cell[name].item()
    assert row["inside_90"] == cell["inside"].sel(level=0.9).item()
    assert all(row["tau"] is None for row in rows if row["run"] == "kalman")
    json.dumps(rows, allow_nan=False)


def test_results_are_left_as_they_are(runs: dict[str, xr.DataTree]) -> None:
    assert all("diagnostics" not in tree.children for tree in runs.values())


def changed(what: str) -> xr.DataTree:
    data = {name: values.copy() for name, values in DATA.items()}
    if what == "frames":
        return run_on(scene(30))
    if what == "points":
        data["points"][5, 0, 1] += 0.01
    if what == "mask":
        data["points"][9, 0, 1] = np.nan
    if what == "truth":
        data["state"][3] += 1.0
    tree = run_on(data)
    if what == "state_dim":
        names = [*DOFS[:2], "elbow.X"]
        tree = xr.DataTree.from_dict(
            {n: g.assign_coords(state_dim=names) if "state_dim" in g.dims else g for n, g in tree.to_dict().items()}
        )
    if what == "observed":
        del tree["observed_data"]
    return tree


@pytest.mark.parametrize(
    ("what", "problem"),
    [
        ("frames", "frames 0-29, but frames 0-39"),
        ("points", "other observed points in frame 5"),
        ("mask", "other observed points in frame 9"),
        ("truth", "other true state in frame 3"),
        ("observed", "observed nothing, but points"),
    ],
)
def test_runs_of_other_data_are_refused(what: str, problem: str) -> None:
    with pytest.raises(InputError, match="b.nc: a run of other data: ") as caught:
        compare({"a": run_on(DATA), "b": changed(what)}, files={"a": "a.nc", "b": "b.nc"})
    assert problem in str(caught.value) and "in a.nc" in str(caught.value)


def test_models_of_other_coordinates_are_compared_by_what_they_share() -> None:
    one, other = run_on(DATA), changed("state_dim")
    comparison = compare({"a": one, "b": other})
    figures, summary = comparison["figures"].dataset, comparison["summary"].dataset
    assert figures["state_dim"].values.tolist() == [*DOFS, "elbow.X"]
    assert np.isnan(summary["tau"].values).tolist() == [[False, False, False, True], [False, False, True, False]]
    assert comparison["winner/winner"].sel(quantity="ess_per_evaluation").item() == TIE
    assert comparison["winner_by_state_dim/winner"].sel(quantity="ess_per_evaluation", state_dim="elbow.X").item() == ""
    for tree in (one, other):
        del tree["observed_data"]
    with pytest.raises(InputError, match="coordinate 'elbow.X', but 'knee<b>.X'"):
        compare({"a": one, "b": other})


def seen_by(count: int, what: str = "") -> xr.DataTree:
    """A run whose points come from so many cameras."""
    data = DATA | ({"state": DATA["state"] + 1.0} if what == "truth" else {})
    tree = run_on(data, with_truth=what != "no truth")
    names = [f"camera_{number}" for number in range(count)]
    points = np.repeat(DATA["points"], count, axis=1)
    tree["observed_data"] = xr.DataTree(xr.Dataset({"points": (("frame", "camera", "marker", "xy"), points)}))
    tree["camera"] = xr.DataTree(xr.Dataset({"focal": ("camera", np.ones(count))}, coords={"camera": names}))
    return tree


@pytest.mark.full
def test_other_cameras_on_the_same_truth_are_compared() -> None:
    comparison = compare({"one": seen_by(1), "two": seen_by(2), "again": seen_by(1)})
    assert json.loads(comparison.attrs["other_cameras"]) == ["two"]
    assert np.isfinite(comparison["summary/error_all"].values).all()
    told = [found.text for found in findings(comparison)]
    start = "Other cameras than in one, but the same motion: two. Errors and coverage can be compared"
    assert any(text.startswith(start) for text in told)
    for what, problem in (("truth", "other true state"), ("no truth", "observed points of shape")):
        with pytest.raises(InputError, match=problem):
            compare({"one": seen_by(1), "two": seen_by(2, what)})


def test_points_that_a_text_file_rounded_are_the_same() -> None:
    data = DATA | {"points": DATA["points"].round(6).astype(np.float32)}
    compare({"a": run_on(DATA), "b": run_on(data, with_truth=False)})


def test_fewer_than_two_runs_and_reserved_names_are_refused() -> None:
    with pytest.raises(InputError, match="two or more"):
        compare({"a": run_on(DATA)})
    with pytest.raises(InputError, match="another name"):
        compare({"a": run_on(DATA), TIE: run_on(DATA)})


@pytest.mark.full
def test_without_truth_time_or_statistics_the_rest_is_there() -> None:
    bare = run_on(DATA, with_truth=False)
    del bare["sample_stats"]
    del bare.attrs["wall_seconds"]
    result = compare({"bare": bare, "bare too": bare.copy()})
    figures = result["figures"].dataset
    for name in ("ess_per_second", "ess_per_evaluation", "error", "joint_error", "inside", "rejection"):
        assert np.isnan(figures[name]).all()
    assert np.isfinite(figures["tau"]).all()
    assert result["winner"]["winner"].values.tolist() == ["", "", ""]
