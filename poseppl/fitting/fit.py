"""One call from a model and data to its params.

    fitted = fit(model, data, kalman_filter)
    result = infer(model, data, kalman_filter, rng_key, params=fitted)

=========================  ===========================================  =====================================================
method                     finds                                        filter
=========================  ===========================================  =====================================================
``"ml"``                   maximum likelihood, standard errors          Kalman, hidden Markov, ensemble Kalman
``"map"``                  the largest posterior density, likewise      the same
``"svi"``                  a Gaussian near the posterior, quickly       with a gradient, also particle filters
``"nuts"``                 posterior draws                              with a gradient; best Kalman or hidden Markov
``"pmmh"``                 posterior draws                              any with an unbiased evidence
``"particle-gibbs"``       posterior draws                              none: it has its own
``"smc2"``                 posterior draws, evidence of the model       any with an unbiased evidence
``"iterated-filtering"``   maximum likelihood, rough standard errors    none: programs are only simulated
=========================  ===========================================  =====================================================

The settings of a method are those of its function: :func:`~poseppl.fitting.optimum.ml_method`,
:func:`~poseppl.fitting.optimum.map_method`, :func:`~poseppl.fitting.sampling.svi_method`,
:func:`~poseppl.fitting.sampling.nuts_method`, :func:`~poseppl.fitting.sampling.pmmh_method`,
:func:`~poseppl.fitting.sampling.particle_gibbs_method`, :func:`~poseppl.fitting.smc_squared.smc2_method` and
:func:`~poseppl.fitting.iterated_filtering.iterated_filtering_method`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import ArrayLike

from poseppl.checks import check_choice, check_key
from poseppl.compilation import double_precision, jit_formula
from poseppl.diagnostics.parameters import check_parameters
from poseppl.diagnostics.verdicts.verdict import INFO, SEVERITIES, WARNING, Findings, Remedy, Verdict
from poseppl.errors import Argument, InputError
from poseppl.filters.base import Filter
from poseppl.filters.particle import particle_filter
from poseppl.fitting.iterated_filtering import iterated_filtering_method
from poseppl.fitting.optimum import map_method, ml_method
from poseppl.fitting.problem import Estimate, Problem, abstract_filter
from poseppl.fitting.results import fit_tree
from poseppl.fitting.sampling import nuts_method, particle_gibbs_method, pmmh_method, svi_method
from poseppl.fitting.smc_squared import smc2_method
from poseppl.program import CompiledModel, Observation, StateSpaceModel
from poseppl.program.frame_inputs import coarse_inputs, stacked_inputs
from poseppl.program.observation import num_frames_of
from poseppl.program.parameters import parameter_bijector
from poseppl.runs.frame_gaps import Gaps
from poseppl.runs.infer import check_labels, fill_frames
from poseppl.runs.run import Progress
from poseppl.runs.settings import settings_of

_LOGGER = logging.getLogger("poseppl")
FitMethod = Literal["ml", "map", "svi", "nuts", "pmmh", "particle-gibbs", "smc2", "iterated-filtering"]
_FUNCTIONS: dict[str, Callable[..., Estimate]] = {
    "ml": ml_method,
    "map": map_method,
    "svi": svi_method,
    "nuts": nuts_method,
    "pmmh": pmmh_method,
    "particle-gibbs": particle_gibbs_method,
    "smc2": smc2_method,
    "iterated-filtering": iterated_filtering_method,
}
_MARKOV = ("nuts", "pmmh", "particle-gibbs")
OWN_FILTER = ("particle-gibbs", "iterated-filtering")


def fit(
    model: CompiledModel,
    data: Observation | Mapping[str, Any],
    filter: Callable[[CompiledModel], Filter] | None = None,
    rng_key: Array | None = None,
    inputs: Any = None,
    *,
    method: FitMethod = "ml",
    start: Mapping[str, Any] | None = None,
    frames: ArrayLike | None = None,
    fill_gaps: bool = False,
    attrs: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> xr.DataTree:
    """Estimate the static parameters of a model, with the states integrated out.

    Args:
        model: The compiled model, with a parameters program. Maximum likelihood reads the params' supports from it, and starts
            from draws of it.
        data: Arrays with a leading T by the name of their site, NaN where nothing was seen; or an Observation.
        filter: `model -> filter`, such as ``kalman_filter`` or ``lambda model: particle_filter(model, 500)``; None for methods
            with a filter of their own.
        rng_key: PRNG key; ``jax.random.key(0)`` if None.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`; None where the model
            takes none.
        method: How; see the module.
        start: Params by name to start from; draws from the prior if None.
        frames: Frame numbers (T,), whole and increasing; 0, 1, ... if None.
        fill_gaps: Whether to insert frames without data where `frames` has gaps, as :func:`poseppl.infer` does. Without it one
            transition leads across, with a warning.
        attrs: Provenance: anything that JSON can hold.
        progress: Whom to report steps and findings to; findings are logged if None.
        settings: Those of the method's function, by name.

    Returns:
        The fit, which ArviZ's functions take; see :mod:`poseppl.fitting.results`. Its findings are those of
        :func:`poseppl.findings_of_fit`; errors and warnings among them are logged. "ml" and "map" compute in double precision
        with filters that are formulas.

    Raises:
        InputError: A setting that the method does not have, a filter that it cannot use, a start that is none, or data that
            are impossible under all params that were tried.
        ValueError: The model is not compiled or has no parameters program, or data or inputs do not fit.
    """
    check_choice(FitMethod, method=method)
    key = jax.random.key(0) if rng_key is None else rng_key
    check_key(key)
    if isinstance(model, StateSpaceModel):
        raise ValueError("The model is not compiled: fit(model.compile(inputs), ...), with the inputs of one frame.")
    function = _FUNCTIONS[method]
    _check_settings(method, function, settings)
    build = _builder(method, filter, settings)
    note = progress.note if progress else _LOGGER.warning
    key_fixed, _, key_method = _splitting()(key)
    gaps = Gaps([] if frames is None else frames)
    exact = abstract_filter(model, build).closed_form and method in ("ml", "map")
    with double_precision(exact or jnp.result_type(float) == jnp.float64):
        observations = model.observe(data)
        check_labels(model, observations, None, frames)
        coarse = coarse_inputs(inputs)
        if gaps and fill_gaps:
            observations, inputs, _ = fill_frames(model, gaps, observations, inputs, None, note)
        inputs = stacked_inputs(inputs, num_frames_of(model.observation_sites, observations))
        inputs = jax.tree.map(_in_working_precision, inputs)
        problem = Problem(model, parameter_bijector(model), build, observations, inputs, key_fixed, progress)
        began = time.perf_counter()
        estimate = function(problem, key_method, start, **settings)
        provenance = {**(attrs or {}), "wall_seconds": time.perf_counter() - began}
        findings = _findings(problem, method, estimate, _of_frames(gaps, fill_gaps, coarse))
        tree = fit_tree(problem, estimate._replace(attrs={**provenance, **estimate.attrs}), method, findings)
    for each in findings:
        if each.severity != INFO:
            note(str(each))
    return tree


@cache
def _splitting() -> Callable[[Array], tuple[Array, ...]]:
    """One program that makes three keys of one, where plain calls are several."""
    return jit_formula(lambda key: tuple(jax.random.split(key, 3)), runs_once=True)


def _check_settings(method: str, function: Callable[..., Estimate], settings: Mapping[str, Any]) -> None:
    """Refuse settings that a method does not have."""
    known = settings_of(function)
    unknown = sorted(set(settings) - set(known))
    if unknown:
        raise InputError(f"method {method!r} has no setting {unknown[0]!r}", field="settings", expected=", ".join(known))


def _builder(method: str, filter: Any, settings: Mapping[str, Any]) -> Callable[[CompiledModel], Filter]:
    """The filter's builder."""
    if method in OWN_FILTER:
        if filter is not None:
            expected = "none: the method has a particle filter of its own, with num_particles"
            raise InputError(f"method {method!r} was given one", field=Argument("filter"), expected=expected)
        number = settings.get("num_particles", 1000)
        return lambda model: particle_filter(model, number)
    if filter is None:
        others = [each for each in get_args(FitMethod) if each not in OWN_FILTER]
        expected = f"a builder such as poseppl.kalman_filter, which {', '.join(others)} need"
        raise InputError(f"method {method!r} was given none", field=Argument("filter"), expected=expected)
    build: Callable[[CompiledModel], Filter] = filter
    return build


def _in_working_precision(leaf: Any) -> Any:
    """Numbers of inputs in the precision of the fit."""
    array = np.asarray(leaf)
    return jnp.asarray(array, jnp.result_type(float)) if array.dtype.kind == "f" else leaf


def _of_frames(gaps: Gaps, filled: bool, coarse: list[str]) -> Findings:
    """Gaps that one transition leads across, and inputs that are rounded away."""
    if gaps and not filled:
        finding = f"{gaps}: one transition leads across a gap, as if its ends were neighbours;"
        yield Verdict(WARNING, finding, (Remedy("insert frames without data by {}", "fill_gaps"),))
    yield from (Verdict(WARNING, text) for text in coarse)


def _findings(problem: Problem, method: str, estimate: Estimate, of_frames: Findings) -> list[Verdict]:
    """Problems of the fit, errors first."""
    found = [*of_frames, *estimate.findings]
    if method in _MARKOV:
        found += check_parameters(
            {name: estimate.draws[..., index] for index, name in enumerate(problem.bijector.coordinate_names)}
        )
    return sorted(found, key=lambda verdict: SEVERITIES.index(verdict.severity))
