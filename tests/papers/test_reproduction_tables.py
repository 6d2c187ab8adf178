from __future__ import annotations

import numpy as np
import pytest
from poseppl_papers.choo_fleet.claims import claims, goals
from poseppl_papers.choo_fleet.figures import draw_variances
from poseppl_papers.choo_fleet.frame_tables import FrameErrors, geometric_variance, log_standard_error, speed_up
from poseppl_papers.choo_fleet.tuning import choose
from poseppl_papers.tables import Table, write_csv, write_netcdf

COLUMNS = ("tracker", "recording", "frame", "method", "size", "seconds", "evaluations", "variance", "log_standard_error")


def errors_of(particle, hmc, runs=60, seed=0):
    """Chi-squared errors with the given variances (setting,)."""
    rng = np.random.default_rng(seed)
    squared = {
        name: np.asarray(values)[:, None] * rng.chisquare(1, (runs, len(values), 5))
        for name, values in (("particle", particle), ("hmc", hmc))
    }
    return FrameErrors("walk", 3, squared, np.zeros((runs, 5)), {"marginal": np.full(runs, 2.0)})


def test_jackknife_is_the_spread_over_repetitions():
    rng = np.random.default_rng(1)
    repeated = [rng.chisquare(1, (30, 1, 6)) for _ in range(400)]
    spread = np.std([np.log(geometric_variance(each)) for each in repeated])
    estimate = np.mean([log_standard_error(each) for each in repeated])
    # four standard errors of a spread of 400; found up to 0.05 at four seeds
    assert estimate == pytest.approx(spread, rel=0.15)


def test_speed_up_of_known_curves():
    cost = {"particle": np.array([[1.0, 2.0, 4.0]]), "hmc": np.array([[0.1, 0.2, 0.4]])}
    found = speed_up([errors_of([0.4, 0.2, 0.1], [0.4, 0.2, 0.1], runs=2000)], cost)
    assert found.low < 10 < found.high and found.high / found.low < 1.3
    # where no number of particles reaches the variance, 1/N is taken on trust
    beyond = speed_up([errors_of([0.4, 0.2, 0.1], [0.01, 0.005, 0.0025], runs=2000)], cost)
    assert beyond.extrapolated == 1.0 and beyond.ratio == pytest.approx(10 * 40, rel=0.2)  # found 0.003


def test_a_speed_up_has_the_scatter_of_the_timing():
    exact = FrameErrors("walk", 3, {"particle": np.full((9, 1, 2), 0.5), "hmc": np.full((9, 1, 2), 0.5)}, np.zeros((9, 2)), {})
    found = speed_up([exact], {"particle": np.array([[8.0], [8.0]]), "hmc": np.array([[1.0], [4.0]])})
    # of two repetitions, medians are 1, 2.5 or 4 seconds, the ends with probability a quarter each
    assert tuple(found) == pytest.approx((8 / 2.5, 8 / 4, 8 / 1, 0.0))
    together = speed_up([exact], {"particle": np.array([[8.0], [32.0]]), "hmc": np.array([[1.0], [4.0]])})
    assert tuple(together) == pytest.approx((8.0, 8.0, 8.0, 0.0))  # a machine that slows down slows both


def claim_tables(ratio):
    low, high = ratio * 0.8, ratio * 1.25
    speed = Table(
        "speed_ups",
        ("tracker", "by", "speed_up", "low", "high", "extrapolated", "published"),
        [("full_body", "seconds", ratio, low, high, 0.5, 2000.0), ("arm", "seconds", 1 / ratio, 1 / high, 1 / low, 0.0, 1 / 8)],
    )
    volumes = Table(
        "volumes",
        ("tracker", "volume", "log10_bound", "lowest", "highest", "published"),
        [("arm", "marginal", 2.3, 2.0, 2.5, 2.0), ("full_body", "marginal", 6.5, 6.0, 7.0, 13.0)],
    )
    return {"speed_ups": speed, "volumes": volumes}


@pytest.mark.parametrize(("ratio", "verdict"), [(1500.0, "holds"), (30.0, "holds in direction"), (0.1, "does not hold")])
def test_verdicts_follow_the_figures(ratio, verdict):
    found = claims(claim_tables(ratio))
    assert found[0].verdict == verdict and "28-D" in found[0].what


def test_least_particles_are_judged_by_standard_deviations_and_by_variances():
    found = claims(claim_tables(1.0))[2:]
    assert [claim.verdict for claim in found] == ["holds", "does not hold", "does not hold", "holds"]
    assert [claim.ours.split()[0] for claim in found] == ["10^2.3", "10^6.5", "10^4.6", "10^13.0"]
    assert "10^6.5 times fewer" in found[1].why and "10^2.6 times more" in found[2].why


def test_an_interval_that_holds_one_decides_nothing():
    assert claims(claim_tables(1.1))[0].verdict == "undecided"


def test_figures_and_files_carry_the_same_numbers(tmp_path):
    rows = [
        ("arm", "walk", 3, method, size, 0.1 * size, 10.0 * size, 1.0 / size, 0.1)
        for method in ("particle", "hmc")
        for size in (1, 2, 4)
    ]
    table = Table("variances", COLUMNS, rows)
    picture = draw_variances({"variances": table})
    lines = [line for line in picture.axes[0].lines if line.get_label() == "HMC filter"]
    np.testing.assert_allclose(lines[0].get_ydata(), table.column("variance", method="hmc"))
    np.testing.assert_allclose(lines[0].get_xdata(), table.column("seconds", method="hmc"))
    write_csv(table, tmp_path)
    text = (tmp_path / f"{table.name}.csv").read_text().splitlines()
    assert text[0] == ",".join(COLUMNS) and text[1] == "arm,walk,3,particle,1,0.1,10,1,0.1"
    write_netcdf([table], tmp_path / "tables.nc")
    import xarray as xr

    with xr.open_datatree(tmp_path / "tables.nc", engine="h5netcdf") as tree:
        np.testing.assert_allclose(tree["variances/variance"], table.column("variance"))


def test_automatic_choice_is_the_cheapest_that_does_not_stick():
    rows = [(10, 0.2, 0.05, 0.0, 2.0, 20.0, 0.0), (10, 0.4, 0.6, 0.0, 1.0, 10.0, 0.0), (40, 0.2, 0.05, 0.0, 1.0, 40.0, 0.0)]
    mixing = Table("tuning", TUNING, rows)
    rhat = Table(
        "burn_in",
        ("leapfrog", "step_size", "burn_in", "rhat"),
        [(10, 0.2, number, value) for number, value in enumerate([2.0, 1.3, 1.05, 1.3, 1.0, 1.0])],
    )
    found = choose([mixing, mixing, rhat])
    assert (found["leapfrog"], found["step_size"], found["burn_in"]) == (10, 0.2, 4)


TUNING = ("leapfrog", "step_size", "rejection", "rejection_standard_error", "tau", "gradients_per_draw", "log_standard_error")


def test_the_rule_of_rejection_is_judged_over_all_lengths_and_at_the_published_one():
    rows = [(10, 0.3, 0.12, 0.0, 1.4, 14.0, 0.0), (10, 0.4, 0.18, 0.0, 1.6, 16.0, 0.0)]
    rows += [(40, 0.2, 0.02, 0.0, 0.8, 33.0, 0.1), (40, 0.3, 0.15, 0.0, 2.0, 80.0, 0.1)]
    cheapest, published = claims({"tuning": Table("tuning", TUNING, rows)})
    # half way between 14 and 16, on a log scale
    assert cheapest.verdict == "holds" and "L = 10" in cheapest.ours and "1.1 (1.1 to 1.1) times" in cheapest.why
    assert published.verdict == "does not hold" and "cheapest at 2.0%" in published.ours and "2.4 (1.8 to 3.2)" in published.why
    # two errors of 0.3 make exp(2 sqrt(2) 0.3) = 2.3; half way between two settings, half of each remains
    noisy = [(*row[:6], 0.3) for row in rows]
    cheapest, published = claims({"tuning": Table("tuning", TUNING, noisy)})
    assert published.verdict == "undecided" and "2.4 (1.0 to 5.7)" in published.why
    assert cheapest.verdict == "undecided" and "1.1 (0.7 to 1.6)" in cheapest.why


def contest_tables(ratio, inside, rate):
    one = Table(
        "contest",
        ("method", "bias", "seconds", "effective_draws_per_second", "effective_draws_per_evaluation"),
        [("HMC, as published", 0.0, 2.0, 10.0, 1.0), ("ours", 0.01, 0.1, 10.0 * ratio, 2.0), ("biased", 3.0, 0.1, 1e6, 1e6)],
    )
    many = Table(
        "contest_sequences",
        ("recording", "method", "markers_in_90", "markers_in_50", "error", "frames_per_second"),
        [("walk", "ours", inside, 0.5, 40.0, rate), ("walk", "over-confident", 0.7, 0.3, 30.0, 500.0)],
    )
    return {"contest": one, "contest_sequences": many}


@pytest.mark.parametrize(
    ("ratio", "inside", "rate", "verdicts"),
    [
        (12.0, 0.9, 70.0, ["reached", "not reached", "reached"]),
        (8.0, 0.9, 40.0, ["not reached", "not reached", "not reached"]),
        (12.0, 0.8, 70.0, ["reached", "not reached", "not reached"]),
    ],
)
def test_goals_need_honest_methods(ratio, inside, rate, verdicts):
    tables = contest_tables(ratio, inside, rate)
    found = goals(tables)
    assert [goal.verdict for goal in found] == verdicts
    assert all(goal.ours.startswith("ours") for goal in found[:2]) and "over-confident" not in found[2].ours


def test_seconds_are_held_to_the_shorter_time_of_the_published_settings():
    tables = contest_tables(15.0, 0.9, 70.0)
    assert goals(tables)[0].verdict == "reached"
    variances = Table("variances", COLUMNS, [("full_body", "walk", 3, "hmc", 32, 1.0, 1.0, 1.0, 0.1)])
    held = goals(tables | {"variances": variances})[0]  # 2 s in the contest
    assert held.verdict == "not reached" and "15 times fewer than theirs in the contest, 7.5 times" in held.ours


@pytest.mark.full
@pytest.mark.parametrize(("lead", "verdict"), [(5.0, "holds"), (0.0, "does not hold"), (-5.0, "does not hold")])
def test_a_filter_has_to_be_higher_in_most_frames(lead, verdict):
    columns = ("tracker", "method", "frame", *(c for n in ("log_likelihood", "log_prior") for c in (n, f"{n}_standard_error")))
    rows = [
        ("full_body", method, frame, 100.0 + lead * (method == "HMC filter"), 1.0, 5.0 + lead * (method == "HMC filter"), 1.0)
        for method in ("HMC filter", "particle filter")
        for frame in range(10)
    ]
    found = claims({"sequence": Table("sequence", columns, rows)})
    assert [claim.verdict for claim in found] == [verdict] * 2
    assert ("both filters do as well" in found[0].why) == (lead == 0.0)
