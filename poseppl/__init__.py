"""Sequential Bayesian inference in high-dimensional state-space models written as NumPyro programs.

A model is three programs; a filter is built for it and run over a sequence, with NaN where data are missing; the result is an
xarray DataTree that ArviZ's functions take (before ArviZ 1 by ``to_arviz``). If you need something other than draws, use the
parts of a run: ``run_filter``, a collector such as ``collect_draws``, and ``result_of_run``.

Example:
    >>> import jax, numpyro, numpyro.distributions as dist
    >>> import poseppl
    >>> def initial(params, inputs):
    ...     numpyro.sample("level", dist.Normal(0.0, 1.0))
    >>> def transition(params, state, inputs):
    ...     numpyro.sample("level", dist.Normal(state["level"], 0.5))
    >>> def observation(params, state, inputs):
    ...     numpyro.sample("height", dist.Normal(state["level"], 1.0))
    >>> model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    >>> data = {"height": [0.3, float("nan"), 0.8]}
    >>> result = poseppl.infer(model, data, poseppl.particle_filter(model, 2000), jax.random.key(0))
    >>> result["posterior/level"].dims
    ('chain', 'draw', 'frame')
    >>> abs(result["summary/level_mean"].sel(frame=0).item() - 0.15) < 0.1
    True
    >>> smoothed = poseppl.smooth(result, poseppl.forward_backward_smoother(model), jax.random.key(1))
    >>> (smoothed["summary/level_mean"] > result["summary/level_mean"]).sel(frame=0).item()
    True

The names below are those of most uses; each is loaded when it is first asked for, so that importing the package costs nothing.
Bodies and toys are in ``poseppl_models``, figures in ``poseppl.report``, cameras and kinematics in ``poseppl.motion.geometry``,
files in ``poseppl.motion.io``, tracking of a body in ``poseppl.motion.tracking``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from poseppl.diagnostics import (
        calibrate as calibrate,
        calibrate_parameters as calibrate_parameters,
        compare as compare,
        comparison_table as comparison_table,
        diagnose as diagnose,
        verdicts as verdicts,
    )
    from poseppl.errors import InputError as InputError, PosepplError as PosepplError
    from poseppl.filters import (
        Filter as Filter,
        FilterInfo as FilterInfo,
        assumed_density_filter as assumed_density_filter,
        ensemble_kalman_filter as ensemble_kalman_filter,
        guided_filter as guided_filter,
        hmc_filter as hmc_filter,
        kalman_filter as kalman_filter,
        particle_filter as particle_filter,
        tempered_filter as tempered_filter,
    )
    from poseppl.filters.scan import Scan as Scan, scan_filter as scan_filter
    from poseppl.fitting import findings_of_fit as findings_of_fit, fit as fit, load_fit as load_fit
    from poseppl.kernels import HMCSettings as HMCSettings
    from poseppl.program import (
        Clamped as Clamped,
        CompiledModel as CompiledModel,
        Diffuse as Diffuse,
        Observation as Observation,
        StateSpaceModel as StateSpaceModel,
        clamp as clamp,
    )
    from poseppl.report import write_report as write_report
    from poseppl.runs.arviz_groups import to_arviz as to_arviz
    from poseppl.runs.batch import infer_batch as infer_batch, one_series as one_series
    from poseppl.runs.checkpoint import Checkpoint as Checkpoint
    from poseppl.runs.collectors import collect_draws as collect_draws
    from poseppl.runs.fitted_params import fitted_params as fitted_params
    from poseppl.runs.forecasting import forecast as forecast, hindcast as hindcast
    from poseppl.runs.infer import infer as infer, smooth as smooth
    from poseppl.runs.log_likelihood import log_likelihood as log_likelihood
    from poseppl.runs.online import Online as Online
    from poseppl.runs.outcome import result_of_run as result_of_run
    from poseppl.runs.posterior_predictive import add_predictive as add_predictive
    from poseppl.runs.predictive import predictive_checks as predictive_checks
    from poseppl.runs.results import load_result as load_result, save_result as save_result
    from poseppl.runs.run import Constant as Constant, Run as Run, RunError as RunError, run_filter as run_filter
    from poseppl.runs.simulation import simulate as simulate
    from poseppl.runs.smoothing import run_smoother as run_smoother
    from poseppl.smoothers import (
        backward_simulation_smoother as backward_simulation_smoother,
        collect_history as collect_history,
        ensemble_kalman_smoother as ensemble_kalman_smoother,
        forward_backward_smoother as forward_backward_smoother,
        trajectory_smoother as trajectory_smoother,
    )

import_module(f"{__name__}.threads").spare_threads()

_HOMES = {
    "Checkpoint": "runs.checkpoint",
    "add_predictive": "runs.posterior_predictive",
    "to_arviz": "runs.arviz_groups",
    "collect_draws": "runs.collectors",
    "calibrate": "diagnostics",
    "calibrate_parameters": "diagnostics",
    "compare": "diagnostics",
    "comparison_table": "diagnostics",
    "diagnose": "diagnostics",
    "verdicts": "diagnostics",
    "InputError": "errors",
    "PosepplError": "errors",
    "Filter": "filters",
    "FilterInfo": "filters",
    "assumed_density_filter": "filters",
    "ensemble_kalman_filter": "filters",
    "guided_filter": "filters",
    "hmc_filter": "filters",
    "kalman_filter": "filters",
    "particle_filter": "filters",
    "tempered_filter": "filters",
    "Scan": "filters.scan",
    "scan_filter": "filters.scan",
    "findings_of_fit": "fitting",
    "fit": "fitting",
    "load_fit": "fitting",
    "fitted_params": "runs.fitted_params",
    "HMCSettings": "kernels",
    "result_of_run": "runs.outcome",
    "forecast": "runs.forecasting",
    "hindcast": "runs.forecasting",
    "infer": "runs.infer",
    "infer_batch": "runs.batch",
    "one_series": "runs.batch",
    "predictive_checks": "runs.predictive",
    "smooth": "runs.infer",
    "Clamped": "program",
    "CompiledModel": "program",
    "Diffuse": "program",
    "Observation": "program",
    "StateSpaceModel": "program",
    "clamp": "program",
    "write_report": "report",
    "load_result": "runs.results",
    "log_likelihood": "runs.log_likelihood",
    "save_result": "runs.results",
    "Constant": "runs.run",
    "Online": "runs.online",
    "Run": "runs.run",
    "RunError": "runs.run",
    "run_filter": "runs.run",
    "simulate": "runs.simulation",
    "backward_simulation_smoother": "smoothers",
    "collect_history": "smoothers",
    "ensemble_kalman_smoother": "smoothers",
    "forward_backward_smoother": "smoothers",
    "trajectory_smoother": "smoothers",
    "run_smoother": "runs.smoothing",
}
"""The module of each public name; the imports above are the same list for type checkers."""

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{home}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "__version__"})


def _version() -> str:
    """The version of the installed package; of a folder that is not installed, "0+unknown"."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("poseppl")
    except PackageNotFoundError:
        return "0+unknown"
