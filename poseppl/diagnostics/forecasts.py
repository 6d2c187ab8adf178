"""Forecasts against the data that came: continuous ranked probability score, ranks, coverage, and predictive densities.

The score of draws X of a forecast and a datum y is CRPS = E|X - y| - E|X - X'| / 2, in the units of the datum: the absolute
error of a forecast without spread, smaller for one that knows its own error, and least on average for the true predictive
distribution (Gneiting and Raftery 2007, doi:10.1198/016214506000001437). For S draws the second term is the mean over their
pairs, so that few draws have no penalty (Ferro 2014, doi:10.1002/qj.2270).

>>> draws = np.random.default_rng(0).normal(size=(20_000, 1))
>>> bool(abs(crps(draws, [0.0])[0] - (np.sqrt(2) - 1) / np.sqrt(np.pi)) < 0.01)
True

A filter's evidence of frame t is log p(z_t | z_(<t)): the frame left out is predicted from those before it, exactly where the
filter is exact (the prequential score of Dawid 1984, doi:10.2307/2981683; leave-future-out cross-validation of Bürkner, Gabry
and Vehtari 2020, doi:10.1080/00949655.2020.1783262, with nothing refitted, as far as no parameters were learned from the data).

    arviz.compare({"trend": one_step_elpd(trend), "level": one_step_elpd(level)})

``arviz.loo`` of draws of states has to remove each datum from the posterior of the state that it observes, by importance
weights. Their variance is infinite if a datum says more about its state than all others do. The estimate is then far too high
and cannot distinguish models, as its Pareto k shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.special import ndtri

from poseppl.arrays import Booleans, Floats, Integers
from poseppl.diagnostics.batches import CONFIDENCE, ratio_interval
from poseppl.diagnostics.calibration import LEVELS, Coverage, coverage, inside_interval, probability_transform
from poseppl.errors import InputError
from poseppl.runs.contents import group_of
from poseppl.runs.results import provenance

HINDCAST_LEVEL = 0.9
"""Nominal probability of the intervals of forecasts from all frames."""


class ForecastScore(NamedTuple):
    """Scores of a forecast of one data site.

    Attributes:
        crps: Continuous ranked probability score, of the site's shape with a leading H, in its units; NaN where
            data are missing.
        transform: Ranks of the data among the draws, in (0, 1), of the same shape.
        coverage: Coverage of the central intervals, over all entries that were seen.
    """

    crps: Floats
    transform: Floats
    coverage: tuple[Coverage, ...]

    @property
    def mean_crps(self) -> float:
        """Mean over all entries that were seen; NaN where none was."""
        seen = self.crps[np.isfinite(self.crps)]
        return float(seen.mean()) if seen.size else float("nan")


def score_forecast(
    forecast: xr.DataTree, data: Mapping[str, ArrayLike], levels: tuple[float, ...] = LEVELS
) -> dict[str, ForecastScore]:
    """Score a forecast by the data that came.

    Args:
        forecast: The forecast of :func:`poseppl.forecast`.
        data: Data by site, with a leading H; NaN where nothing was seen. Sites may be left out.
        levels: Nominal probabilities of the intervals.

    Returns:
        The score of each site.

    Raises:
        InputError: The forecast predicts no data, has no such site, or another shape; or data are infinite.
    """
    drawn = group_of(forecast, "predictions")
    if not drawn.data_vars:
        raise InputError("the forecast predicts no data", expected="the result of poseppl.forecast, of a model with data sites")
    scores = {}
    for name, given in data.items():
        if name not in drawn:
            raise InputError("no site of the forecast", field=name, expected=f"some of {sorted(map(str, drawn.data_vars))}")
        draws, true = drawn[name].values, np.asarray(given, float)
        if true.shape != draws.shape[2:]:
            raise InputError(
                f"data of shape {true.shape}", field=name, expected=f"{draws.shape[2:]}, the frames of the forecast"
            )
        if np.isinf(true).any():
            raise InputError("infinite data", field=name, expected="finite numbers, NaN where nothing was seen")
        seen = np.isfinite(true)
        covered = (coverage(inside_interval(draws, true, level), level, valid=seen) for level in levels)
        ranks = np.where(seen, probability_transform(draws, true), np.nan)
        scores[name] = ForecastScore(crps(draws.reshape(-1, *true.shape), true), ranks, tuple(covered))
    return scores


class HindcastScore(NamedTuple):
    """Scores of every frame's forecasts of one data site, by lead.

    Attributes:
        crps: Mean score (H,), in the data's units, over starts and entries.
        crps_error: Its standard errors (H,), by batches of neighbouring starts.
        coverage: Coverage of the central 90 % intervals at each lead.
        overall: Their coverage over all leads.
        reach: Deviation of `overall` from 90 % that right forecasts exceed in 5 % of series.
    """

    crps: Floats
    crps_error: Floats
    coverage: tuple[Coverage, ...]
    overall: Coverage
    reach: float


def score_hindcasts(predicted: xr.Dataset, result: xr.DataTree) -> dict[str, HindcastScore]:
    """Score forecasts from all frames of a result by its data.

    Args:
        predicted: The forecasts of :func:`poseppl.runs.forecasting.hindcast`.
        result: The result that they start from.

    Returns:
        The score of each site; smaller is better, so that models of the same data are compared by them.
    """
    starts, leads = predicted.sizes["start"], predicted["lead"].values
    scores = {}
    for name, drawn in predicted.data_vars.items():
        observed = np.asarray(result["observed_data"].dataset[name].values, float)
        true = observed[np.arange(starts)[:, None] + leads]
        draws, seen = drawn.transpose("chain", "draw", "start", "lead", ...).values, np.isfinite(true)
        inside, each = inside_interval(draws, true, HINDCAST_LEVEL), crps(draws.reshape(-1, *true.shape), true)
        parts = [ratio_interval(np.nan_to_num(each[:, lead]), seen[:, lead]) for lead in range(len(leads))]
        covered = tuple(coverage(inside[:, lead], HINDCAST_LEVEL, valid=seen[:, lead]) for lead in range(len(leads)))
        overall = coverage(inside, HINDCAST_LEVEL, valid=seen)
        means, errors, _ = np.array(parts).T
        scores[str(name)] = HindcastScore(means, errors, covered, overall, _reach(inside, seen))
    return scores


def _reach(inside: Booleans, seen: Booleans) -> float:
    """Deviation of the share (start, lead, ...) from its level that right forecasts exceed in at most 5 % of series.

    If forecasts are right, those from starts a horizon H apart are uncorrelated. The share over n starts has therefore at most
    the variance of n / H uncorrelated means of a start. That of a mean is known about the level, which is given if they are
    right, and lies between that of independent trials and that of a single one.
    """
    starts, horizon = inside.shape[:2]
    trial = HINDCAST_LEVEL * (1 - HINDCAST_LEVEL)
    residual = np.where(seen, inside - HINDCAST_LEVEL, 0.0).reshape(starts, -1).sum(1)
    count = seen.reshape(starts, -1).sum(1)
    variance = np.clip(np.square(residual).sum(), trial * count.sum(), trial * np.square(count).sum())
    return float(ndtri((1 + CONFIDENCE) / 2) * np.sqrt(horizon * variance) / max(count.sum(), 1))


def add_hindcasts(result: xr.DataTree, predicted: xr.Dataset) -> xr.DataTree:
    """Add the scores of forecasts from all frames to the result that they start from, for verdicts and report.

    Args:
        result: The result.
        predicted: Its forecasts by :func:`poseppl.runs.forecasting.hindcast`.

    Returns:
        The result with the group ``hindcasts`` (a shallow copy): ``crps``, ``crps_error``, ``coverage`` and ``coverage_se``
        (site, lead), ``overall``, ``overall_se`` and ``overall_reach`` (site,), those of all leads.
    """
    scores = score_hindcasts(predicted, result)
    figures = xr.concat([_figures(score, predicted["lead"].values) for score in scores.values()], dim="site")
    added = result.copy()
    added["hindcasts"] = xr.DataTree(figures.assign_coords(site=list(scores)))
    return added


def _figures(score: HindcastScore, leads: Integers) -> xr.Dataset:
    shares, errors = np.array([each[1:3] for each in score.coverage]).T
    by_lead = {"crps": score.crps, "crps_error": score.crps_error, "coverage": shares, "coverage_se": errors}
    overall = {"overall": score.overall.estimate, "overall_se": score.overall.standard_error, "overall_reach": score.reach}
    return xr.Dataset({name: ("lead", values) for name, values in by_lead.items()} | overall, {"lead": leads})


def forecasts_of_runs(scores: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Groups that :func:`add_hindcasts` added to results, by run, with a dimension ``run``; those without are left out."""
    known = {name: data for name, data in scores.items() if data}
    return xr.concat(known.values(), dim="run", join="outer").assign_coords(run=list(known)) if known else xr.Dataset()


def crps(draws: ArrayLike, data: ArrayLike) -> Floats:
    """Continuous ranked probability score.

    Args:
        draws: (S, ...), at least two.
        data: (...), NaN where missing.

    Returns:
        (...), in the units of the data; NaN where they are missing.
    """
    ordered, true = np.sort(np.asarray(draws, float), axis=0), np.asarray(data, float)
    number = len(ordered)
    # the sum of all |X_i - X_j| of i < j, where the i-th of the ordered draws counts 2 i - S + 1 times
    counts = (2.0 * np.arange(number) - number + 1).reshape(-1, *(1,) * true.ndim)
    spread = 2 * (counts * ordered).sum(0) / (number * max(number - 1, 1))
    return np.asarray(np.abs(ordered - true).mean(0) - spread / 2)


def one_step_elpd(result: xr.DataTree) -> Any:
    """The expected log predictive density one frame ahead, as the installed ArviZ's ``compare`` takes it.

    Args:
        result: The result of a filter or of its smoothing, or one of many series.

    Returns:
        ArviZ's ``ELPDData``, pointwise by frame with data (and by series); the effective number of parameters is 0, since
        nothing was fitted to what is predicted.

    Raises:
        InputError: The filter has no evidence, the result has no data, or a frame's data were impossible.
    """
    stats, data = group_of(result, "sample_stats"), group_of(result, "observed_data")
    if "log_evidence" not in stats or provenance(result).get("evidence") == "none":
        raise InputError("the result has no evidence of its frames", expected="that of a filter with one, such as particle")
    if not data.data_vars:
        raise InputError("the result has no data", field="observed_data", expected="the data that were filtered")
    evidence = stats["log_evidence"].astype(float)
    seen = [values.notnull().any([dim for dim in values.dims if dim not in evidence.dims]) for values in data.values()]
    terms = evidence.stack(point=evidence.dims).values[np.any([each.stack(point=evidence.dims) for each in seen], axis=0)]
    if not np.isfinite(terms).all():
        expected = "a model under which they are possible"
        raise InputError(f"the data of {np.sum(~np.isfinite(terms))} frames are impossible under the model", expected=expected)
    return _elpd_data(terms, int(result.attrs.get("num_particles", 1)))


def _elpd_data(terms: np.ndarray[Any, Any], number: int) -> Any:
    """ArviZ's container of pointwise log predictive densities (n,) that need no importance weights."""
    total, error = float(terms.sum()), float(np.sqrt(len(terms) * terms.var()))
    each, shape = xr.DataArray(terms, dims="point"), xr.DataArray(np.zeros(len(terms)), dims="point")
    if int(version("arviz").partition(".")[0]) >= 1:
        made: Any = import_module("arviz_stats.utils").ELPDData
        return made("loo", total, error, 0.0, number, len(terms), "log", False, 0.7, each, shape)
    values: dict[str, Any] = {
        "elpd_loo": total,
        "se": error,
        "p_loo": 0.0,
        "n_samples": number,
        "n_data_points": len(terms),
        "warning": False,
    }
    values |= {"loo_i": each.rename("loo_i"), "pareto_k": shape, "scale": "log", "good_k": 0.7}
    before: Any = import_module("arviz.stats.stats_utils").ELPDData
    return before(data=list(values.values()), index=list(values))
