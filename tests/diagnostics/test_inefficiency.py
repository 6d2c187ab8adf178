from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from arviz_stats.base import array_stats
from synthetic import autoregression

from poseppl.diagnostics import autocorrelation, inefficiency, inside_interval, mixing, split_rhat, windowed_inefficiency
from poseppl.diagnostics.inefficiency import autocovariance

SHAPES = [(1, 4), (1, 5), (4, 4), (3, 5), (4, 6), (4, 7), (2, 8), (2, 9), (10, 26), (4, 27), (3, 101), (1, 50)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rho", [-0.6, 0.0, 0.5, 0.95])
def test_equal_to_arviz(shape: tuple[int, int], rho: float) -> None:
    """Exact, on odd and even lengths, antithetic, independent and slow chains; the slow ones disagree besides."""
    rng = np.random.default_rng(shape[1])
    draws = autoregression(rng, (*shape, 20), rho) + 3 * (rho > 0.9) * rng.standard_normal((shape[0], 1, 20))
    ess = array_stats.ess(draws, chain_axis=0, draw_axis=1, method="mean")
    relative = array_stats.ess(draws, chain_axis=0, draw_axis=1, method="mean", relative=True)
    mcse = array_stats.mcse(draws, chain_axis=0, draw_axis=1, method="mean")
    ours = mixing(draws)
    np.testing.assert_allclose(ours.tau, 1 / relative, rtol=1e-10)
    np.testing.assert_allclose(ours.ess, ess, rtol=1e-10)
    np.testing.assert_allclose(ours.mcse, mcse, rtol=1e-10)
    if shape[0] > 1:
        rhat = array_stats.rhat(draws, chain_axis=0, draw_axis=1, method="split")
        np.testing.assert_allclose(ours.rhat, rhat, rtol=1e-10)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_autoregressive_chains_have_their_exact_inefficiency(rho: float) -> None:
    """tau = (1 + rho) / (1 - rho), within 5 standard errors over replicates and the bias 2 % of a finite window."""
    draws = autoregression(np.random.default_rng(1), (4, 3000, 100), rho)
    exact = (1 + rho) / (1 - rho)
    for estimate in (inefficiency(draws), windowed_inefficiency(draws)):
        error = estimate.std(ddof=1) / np.sqrt(estimate.size)
        assert abs(estimate.mean() - exact) < 5 * error + 0.02 * exact
        # The wrong variant: correlations summed on one side only.
        if rho:
            assert abs((1 + estimate.mean()) / 2 - exact) > 5 * error + 0.02 * exact


@pytest.mark.parametrize(("rho", "shape"), [(0.5, (4, 2500)), (0.9, (4, 2500)), (0.9, (20, 500))])
def test_the_error_of_tau_is_that_of_replicates(rho: float, shape: tuple[int, int]) -> None:
    """Within a factor that the replicates' own error, 5 %, leaves clear of a missing 2 or root: Geyer's window is shorter."""
    found = mixing(autoregression(np.random.default_rng(10), (*shape, 200), rho))
    windowed, geyer = (estimate.std(ddof=1) / np.median(found.tau_se) for estimate in (found.tau_windowed, found.tau))
    assert 0.55 < geyer < 1.35 and 0.75 < windowed < 1.15


def test_variance_of_a_mean_is_tau_over_n() -> None:
    """Eq. 8 itself: the spread of replicated means, within 5 standard errors of a variance."""
    draws = autoregression(np.random.default_rng(2), (1, 1000, 2000), 0.6)
    variance = draws.mean(axis=(0, 1)).var(ddof=1)
    predicted = inefficiency(draws).mean() / 1000
    assert abs(variance / predicted - 1) < 5 * np.sqrt(2 / 2000)


def test_antithetic_chains_keep_their_advantage_without_a_floor() -> None:
    draws = autoregression(np.random.default_rng(3), (4, 4000, 20), -0.8)
    assert abs(windowed_inefficiency(draws).mean() - 0.2 / 1.8) < 0.03
    np.testing.assert_allclose(inefficiency(draws), 1 / np.log10(16000))


def test_stuck_chains_cost_their_length() -> None:
    """Chains that sit in different places are worth one draw each."""
    rng = np.random.default_rng(4)
    draws = 1000 * rng.standard_normal((10, 1, 5)) + rng.standard_normal((10, 40, 5))
    np.testing.assert_allclose(windowed_inefficiency(draws), 40, rtol=0.02)
    assert (inefficiency(draws) > 20).all()
    assert (split_rhat(draws) > 10).all()


@pytest.mark.parametrize("case", ["constant", "short", "nan", "single"])
def test_undefined_is_nan_and_silent(case: str) -> None:
    draws = np.random.default_rng(5).standard_normal((3, 20, 2, 4))
    if case == "constant":
        draws[..., 0] = 2.0
    elif case == "nan":
        draws[0, 3, :, 0] = np.inf
        draws[0, 4, :, 0] = np.nan
    elif case == "short":
        draws = draws[:, :3]
    else:
        draws = draws[:1]
    found = mixing(draws)
    for name, values in found._asdict().items():
        assert values.shape == (2, 4)
        if case == "short" or (case == "single" and name == "rhat"):
            assert np.isnan(values).all()
        elif case == "single":
            assert np.isfinite(values).all()
        else:
            assert np.isnan(values[:, 0]).all()
            assert np.isfinite(values[:, 1:]).all()


def test_autocorrelation_of_autoregression() -> None:
    rho = autocorrelation(autoregression(np.random.default_rng(6), (4, 4000, 50), 0.7), max_lag=5)
    assert rho.shape == (6, 50)
    error = rho.std(axis=1, ddof=1) / np.sqrt(50)
    assert (np.abs(rho.mean(axis=1) - 0.7 ** np.arange(6)) <= 5 * error + 0.002).all()


def test_autocovariance_is_about_the_mean_of_all_chains() -> None:
    draws = np.random.default_rng(7).standard_normal((3, 9, 2)) + np.array([0.0, 5.0, 1.0])[:, None, None]
    centred = draws - draws.mean(axis=(0, 1))
    expected = [(centred[:, : 9 - lag] * centred[:, lag:]).sum(axis=1) / 9 for lag in range(9)]
    np.testing.assert_allclose(autocovariance(draws), np.stack(expected, axis=1), atol=1e-12)
    assert not np.allclose(array_stats.autocov(draws, axis=1), np.stack(expected, axis=1), atol=0.1)  # about their own


@pytest.mark.parametrize("function", [inefficiency, windowed_inefficiency, split_rhat])
def test_functions_of_draws_take_what_arviz_takes(function) -> None:
    draws = np.random.default_rng(8).standard_normal((4, 30, 5, 2))
    state = xr.DataArray(draws, dims=("chain", "draw", "frame", "state_dim"), coords={"state_dim": ["a", "b"]})
    expected = function(draws)
    found = function(state.transpose("frame", "draw", "state_dim", "chain"))
    assert found.dims == ("frame", "state_dim") and list(found["state_dim"].values) == ["a", "b"]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    posterior = xr.Dataset({"state": state, "height": ("frame", np.ones(5))})
    for data in (posterior, xr.DataTree.from_dict({"posterior": posterior, "sample_stats": xr.Dataset()})):
        each = function(data)
        assert list(each.data_vars) == ["state"]
        np.testing.assert_allclose(each["state"], expected, rtol=1e-12)


def test_diagnostics_stand_on_arviz(monkeypatch: pytest.MonkeyPatch) -> None:
    """On its autocovariance and its intervals: with others there are other figures."""
    draws, truth = np.random.default_rng(9).standard_normal((4, 30, 2)), np.zeros(2)
    functions = inefficiency, windowed_inefficiency, lambda values: inside_interval(values, truth, 0.5)
    before = [function(draws) for function in functions]
    monkeypatch.setattr(type(array_stats), "autocov", lambda self, ary, axis: np.square(ary))
    monkeypatch.setattr(type(array_stats), "eti", lambda self, ary, prob, axis: np.full((2, 2), np.inf))
    assert all((function(draws) != old).any() for function, old in zip(functions, before, strict=True))
