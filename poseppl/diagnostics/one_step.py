r"""One-step-ahead predictive densities of a result as ArviZ's expected log predictive density, to compare models by.

A filter's evidence of frame t is log p(z_t | z_(<t)): the frame left out is predicted from those before it, exactly where the
filter is exact (the prequential score of Dawid 1984, doi:10.2307/2981683; leave-future-out cross-validation of Bürkner, Gabry
and Vehtari 2020, doi:10.1080/00949655.2020.1783262, with nothing refitted, as far as no parameters were learned from the data).

    arviz.compare({"trend": one_step_elpd(trend), "level": one_step_elpd(level)})

``arviz.loo`` of draws of states has to remove each datum from the posterior of the state that it observes, by importance
weights. Their variance is infinite if a datum says more about its state than all others do. The estimate is then far too high
and cannot distinguish models, as its Pareto k shows.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from poseppl.errors import InputError
from poseppl.runs.contents import group_of
from poseppl.runs.results import provenance


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
