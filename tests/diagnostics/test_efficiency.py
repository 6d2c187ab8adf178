"""Thresholds and expected gains against exact chains, and the verdicts that state them."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from synthetic import autoregression, synthetic_result

from poseppl.diagnostics import diagnose, split_rhat, verdicts
from poseppl.diagnostics.efficiency import (
    ESS_LOW,
    MOVES,
    RHAT_HIGH,
    TAU_BAD,
    best_acceptance,
    gain_of_longer_trajectories,
    gain_of_step_size,
    moves_of,
)
from poseppl.diagnostics.predictive import implied_coverage
from poseppl.report.tables import cards, inefficiency_table
from poseppl.runs.results import Names, build_result


def test_thresholds_are_what_their_derivations_say() -> None:
    assert 0.88 < implied_coverage(1 + 1 / ESS_LOW) < 0.885
    assert pytest.approx(2.3, abs=0.05) == 1 / (RHAT_HIGH**2 - 1)
    assert 8 / 0.331 < TAU_BAD < 8 / 0.331 + 1


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_rhat_follows_from_the_ess_of_half_a_chain(rho: float) -> None:
    """Within 5 standard errors of the mean over 1000 quantities, and the next order of 1 / ESS."""
    draws = autoregression(np.random.default_rng(0), (4, 400, 1000), rho)
    found = split_rhat(draws) ** 2 - 1
    each = 200 * (1 - rho) / (1 + rho)
    # independent draws have R-hat = 1 on average: the variance within chains lacks its own part, 1 / 200
    assert abs(found.mean() - (1 / each - 1 / 200)) < 5 * found.std() / np.sqrt(len(found)) + 0.1 / each


@pytest.mark.parametrize(("kind", "rate"), [("random walk", 0.234), ("Langevin", 0.574), ("HMC", 0.651)])
def test_best_acceptance_rates_are_the_published_ones(kind: str, rate: float) -> None:
    assert best_acceptance(kind) == pytest.approx(rate, abs=1e-3)
    assert gain_of_step_size(rate, kind) == pytest.approx(1.0, abs=1e-3)
    assert (gain_of_step_size(np.linspace(0.0, 1.0, 50), kind) >= 1).all()


def test_gain_of_the_step_size_is_that_of_a_random_walk_in_many_dimensions() -> None:
    """Squared jumps of Metropolis chains on a Gaussian of 50 coordinates, at twice and a third of the best step (5 % error)."""
    rng, dimension = np.random.default_rng(1), 50
    position = rng.standard_normal((4000, dimension))

    def jumps(scale: float) -> tuple[float, float]:
        step = scale / np.sqrt(dimension) * rng.standard_normal(position.shape)
        ratio = -0.5 * (np.square(position + step) - np.square(position)).sum(1)
        accepted = np.exp(np.minimum(ratio, 0.0))
        return float(accepted.mean()), float((accepted * np.square(step).sum(1)).mean())

    best = jumps(2.38)[1]
    for scale in (4.76, 0.8):
        acceptance, distance = jumps(scale)
        assert gain_of_step_size(acceptance, "random walk") == pytest.approx(best / distance, rel=0.15)


def test_longer_trajectories_divide_tau_as_a_rotation_does() -> None:
    angle = 0.3
    tau = [(1 + np.cos(each)) / (1 - np.cos(each)) for each in (angle, 2 * angle)]
    assert gain_of_longer_trajectories(tau[0]) == pytest.approx(tau[0] / tau[1] / 2)


def chains(rho: float = 0.3, shape: tuple[int, int] = (4, 200), apart: float = 0.0, **stats: float) -> xr.DataTree:
    """Ten frames of two coordinates, in half of which chains keep to places that are apart; in 2 s."""
    state = autoregression(np.random.default_rng(2), (*shape, 10, 2), rho)
    state[:, :, :5] += apart * np.arange(shape[0])[:, None, None, None]
    found = {name: np.full(10, value) for name, value in stats.items()}
    attrs = {"wall_seconds": 2.0, "frames_run": 10, "settings": {"num_chains": shape[0], "num_updates": shape[1]}}
    return diagnose(build_result(state=state, names=Names(("hip", "knee")), sample_stats=found, attrs=attrs))


def texts(tree: xr.DataTree) -> str:
    return "\n".join(map(str, verdicts(tree)))


@pytest.mark.parametrize(("gradients", "kind"), [(0, "random walk"), (800, "Langevin"), (8000, "HMC")])
def test_the_kind_of_moves_is_reported_by_their_gradients(gradients: float, kind: str) -> None:
    assert kind in MOVES and moves_of(chains(num_gradient=gradients)).kind == kind


def test_a_step_size_that_is_too_small_is_reported_with_its_gain() -> None:
    slow = texts(chains(rho=0.9, acceptance_rate=0.99, num_gradient=8000.0))
    assert "info: Only 1 % of the proposals are rejected: the step size is too small; at 35 % (HMC)" in slow
    assert "about 4.0 times the ESS per evaluation: lower target_acceptance, or raise step_size." in slow
    exact = texts(chains(rho=0.0, acceptance_rate=1.0))
    assert "rejected" not in exact, "independent draws cannot gain"
    assert "rejected" not in texts(chains(shape=(4, 3), acceptance_rate=1.0)), "nor is it known of three draws"


def test_too_few_draws_and_too_many_name_the_factor() -> None:
    few = chains(rho=0.99, shape=(4, 40))
    least = float(few["diagnostics/ess"].min())
    assert f"for an ESS of 100, draw {100 / least:.0f} times as much: raise num_updates or num_chains." in texts(few)
    many = chains(rho=0.0, shape=(4, 1000))
    times = float(many["diagnostics/ess"].min()) / 100
    assert f"a tenth of the posterior SD, {times:.0f} times as fast. To save time, lower num_updates." in texts(many)
    assert "as fast" not in texts(chains(rho=0.0, shape=(4, 1000), apart=3.0)), "chains that disagree have none to spare"


def test_chains_that_disagree_come_first() -> None:
    apart, agreeing = chains(apart=5.0), chains()
    first = next(line for line in texts(apart).splitlines() if line.startswith("warning"))
    assert "the chains disagree, and tau says little there" in first
    assert cards(apart)[0][1] == "largest R-hat: the chains disagree"
    assert cards(agreeing)[0][1] == "median inefficiency factor τ"


def test_the_table_of_coordinates() -> None:
    tree = chains(rho=0.5, num_gradient=400.0)
    better = tree["diagnostics/tau"].max("frame").idxmin().item()
    tree["diagnostics"]["rhat"].loc[{"state_dim": better}] = 1.5
    rows = inefficiency_table(tree)
    data = tree["diagnostics"].dataset
    assert rows[0]["state_dim"] == better, "by R-hat, where chains disagree"
    for row in rows:
        tau = data["tau"].sel(state_dim=row["state_dim"])
        assert row["ess_per_second"] == pytest.approx(800 / tau.mean() / 0.2)
        assert row["ess_per_gradient"] == pytest.approx(800 / tau.mean() / 400)
        value, error = map(float, row["tau"].split(" ± "))
        assert value == pytest.approx(float(tau.mean()), abs=0.06) and 0 < error < 0.5
    assert dict(map(reversed, cards(tree)))["ESS per gradient"]  # type: ignore[arg-type]


def test_particles_have_no_table_of_coordinates() -> None:
    tree = diagnose(synthetic_result(weighted=True))
    assert inefficiency_table(tree) == [] and "ESS per gradient" not in [label for _, label in cards(tree)]
