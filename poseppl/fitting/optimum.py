r"""Maximum likelihood and maximum a posteriori: L-BFGS in unconstrained coordinates, with the observed information.

With \ell the log-likelihood, or for "map" \ell + log p(params), the density of the constrained params, and u its optimum,

    I = -d2 \ell / du2,    Cov(u) = I^-1,    Var(params) = J I^-1 J^T,    J = d params / du,

the delta method. Draws are those of N(u, I^-1), mapped to params. The search is scipy's L-BFGS-B; how far it may be from the
optimum is judged by Newton's decrement g^T I^-1 g / 2, which is in units of log-likelihood, and not by scipy's message.

I comes from differences of gradients, whose program the search has compiled. It comes from second derivatives if two steps do
not agree to a millionth of the least information, as in float32.

A direction in which \ell does not change has no standard error. If a bounded param can move to its bound without loss, the
optimum is at the bound. If both directions are flat, or I has no positive eigenvalue, the data do not identify the param.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.optimize import minimize

from poseppl.arrays import Floats
from poseppl.checks import check_at_least
from poseppl.compilation import jit_formula
from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Findings, Remedy, Verdict
from poseppl.errors import Argument, InputError
from poseppl.fitting.problem import Estimate, Problem, draw_prior, num_starting_draws
from poseppl.program import CompiledModel
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.parameters import parameter_bijector

_STEP = 3.0
"""How far a coordinate is moved to see whether the objective is flat: a factor of 20 for a positive param."""
_FLAT = 0.02
"""Units of log-likelihood that such a move may cost where it is."""
_DECREMENT = 1e-3
"""Units of log-likelihood that the optimum may lie above."""
_WEAK = 1e-4
"""Information in a direction, in units of the prior's precision, below which it is not identified."""
_APART = 0.1
"""Units of log-likelihood by which an optimum is another one."""
_NUM_DRAWS, _NUM_PRIOR_DRAWS = 1000, 64
_STEP_OF_DIFFERENCES, _RATIO = 1e-4, 1.7
"""Step of differences of gradients, in standard errors, and the second step in units of it: twice it may round alike."""
_DIFFERENT = 1e-6
"""Share of the least information by which differences of two steps may differ."""


class _Search(NamedTuple):
    """One search: its optimum (p,), the value there, rough standard errors, the values on the way and scipy's message."""

    optimum: Floats
    value: float
    deviations: Floats
    trace: list[float]
    message: str


class _Draws(NamedTuple):
    """Draws of the prior to start from (K, p), standard deviations of the prior (p,), and standard normal numbers (R, p)."""

    starts: Floats
    scales: Floats
    noise: Floats


def ml_method(
    problem: Problem, rng_key: Array, start: Mapping[str, Any] | None, *, num_starts: int = 4, max_steps: int = 500
) -> Estimate:
    """Maximum likelihood, with standard errors by the observed information.

    Args:
        problem: The problem.
        rng_key: PRNG key, of the starts and the draws.
        start: Params by name to start from; the best of a few draws of the prior if None.
        num_starts: Searches, from different starts; one where `start` is given.
        max_steps: Steps of a search at most.

    Raises:
        InputError: The data are impossible at every start.
    """
    return optimum(problem, rng_key, start, penalised=False, num_starts=num_starts, max_steps=max_steps)


def map_method(
    problem: Problem, rng_key: Array, start: Mapping[str, Any] | None, *, num_starts: int = 4, max_steps: int = 500
) -> Estimate:
    """Maximum a posteriori: the largest posterior density of the constrained params, with standard errors by its curvature.

    Args:
        problem: The problem.
        rng_key: PRNG key, of the starts and the draws.
        start: Params by name to start from; the best of a few draws of the prior if None.
        num_starts: Searches, from different starts; one where `start` is given.
        max_steps: Steps of a search at most.

    Raises:
        InputError: The data are impossible at every start.
    """
    return optimum(problem, rng_key, start, penalised=True, num_starts=num_starts, max_steps=max_steps)


def optimum(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    penalised: bool,
    num_starts: int = 4,
    max_steps: int = 500,
) -> Estimate:
    """Maximise the likelihood, or where the prior counts (`penalised`) the posterior density; see the methods."""
    check_at_least(1, num_starts=num_starts, max_steps=max_steps)
    _check_smooth(problem)
    objective = "log_penalised" if penalised else "log_likelihood"
    slope = problem.compiled("slope", objective)

    def evaluate(u: Any) -> tuple[float, Floats]:
        value, gradient = slope(u)
        return np.asarray(value).item(), np.asarray(gradient, np.float64)

    number = num_starts if start is None else 1
    drawn = _Draws(*(np.asarray(each, np.float64) for each in _draws_program(problem.model, number)(rng_key)))
    starts = problem.starts(rng_key, number, start, lambda u: evaluate(u)[0], drawn.starts)
    searches = [_search(evaluate, each, max_steps, problem.advance) for each in starts]
    best = max(searches, key=lambda search: search.value)
    information = _information(problem, objective, lambda u: evaluate(u)[1], best)
    flat = _flat_directions(problem, lambda u: evaluate(u)[0], best, information, drawn.scales, penalised)
    covariance = _covariance(information, flat)
    decrement = _decrement(evaluate(best.optimum)[1], information, flat)
    converged = decrement < _DECREMENT
    findings = [*dict.fromkeys(flat.values()), *_convergence(decrement, best, searches)]
    likelihood = best.value - (float(_prior_program(problem.model)(best.optimum)) if penalised else 0.0)
    attrs: dict[str, Any] = {"converged": converged, "log_likelihood": likelihood, "newton_decrement": decrement}
    attrs["optima"] = [search.value for search in searches]
    draws = _draws(drawn.noise, best.optimum, covariance)
    return Estimate(best.optimum, covariance, draws, {}, best.trace, attrs, tuple(findings))


@memoized_builder
def _draws_program(model: CompiledModel, number: int) -> Callable[..., Any]:
    """All that a fit with `number` starts draws, as :class:`_Draws`."""
    bijector, first = parameter_bijector(model), num_starting_draws(number)

    def draw(rng_key: Array) -> tuple[Array, Array, Array]:
        key_starts, key_noise, _ = jax.random.split(rng_key, 3)
        draws = draw_prior(model, bijector, key_starts, max(_NUM_PRIOR_DRAWS, first))
        scales = jnp.std(draws, 0)
        noise = jax.random.normal(key_noise, (_NUM_DRAWS, bijector.dimension))
        return draws[:first], jnp.where(scales > 0, scales, 1.0), noise

    return jit_formula(draw, runs_once=True)


@memoized_builder
def _prior_program(model: CompiledModel) -> Callable[..., Any]:
    """Log-density of the params of u (p,)."""
    constrained = parameter_bijector(model).to_params
    return jit_formula(lambda u: model.log_parameters(constrained(u)))


def _check_smooth(problem: Problem) -> None:
    """Refuse a filter whose likelihood jumps as params move, or has no gradient."""
    built = problem.filter
    if not built.differentiable or built.evidence == "weights":
        expected = "a Kalman, hidden Markov or ensemble Kalman filter, or method 'svi', 'pmmh' or 'iterated-filtering'"
        raise InputError("its likelihood is no smooth function of the params", field=Argument("filter"), expected=expected)


def _search(evaluate: Callable[[Any], tuple[float, Floats]], start: Floats, max_steps: int, advance: Any) -> _Search:
    """L-BFGS-B from one start."""
    trace: list[float] = []

    def loss(u: Floats) -> tuple[float, Floats]:
        value, gradient = evaluate(u)
        if np.isfinite(value) and np.isfinite(gradient).all():
            trace.append(value)
            return -value, -gradient
        return -trace[-1] + 1e3 * (1.0 + abs(trace[-1])) if trace else 1e10, np.zeros_like(u)

    options = {"maxiter": max_steps, "ftol": 1e-13, "gtol": 1e-6}
    found = minimize(loss, start, jac=True, method="L-BFGS-B", options=options, callback=lambda _: advance(1))
    deviations = np.sqrt(np.abs(np.diagonal(found.hess_inv.todense())))
    return _Search(np.asarray(found.x, np.float64), -float(found.fun), deviations, trace, str(found.message))


def _information(problem: Problem, objective: str, gradient: Callable[[Floats], Floats], best: _Search) -> Floats:
    """The observed information (p, p): by differences of gradients, or where these are rough by second derivatives.

    Second derivatives are another program, which takes longer to compile than many gradients to compute.
    """
    deviations = best.deviations
    for _ in range(3 if jnp.result_type(float) == jnp.float64 else 0):
        information, error = _differences(gradient, best.optimum, _STEP_OF_DIFFERENCES * deviations)
        if not (np.isfinite(information).all() and (np.diagonal(information) > 0).all()):
            break
        deviations = 1 / np.sqrt(np.diagonal(information))
        units = np.outer(deviations, deviations)
        if np.abs(error * units).max() < _DIFFERENT * np.linalg.eigvalsh(information * units)[0]:
            return information
    second: Floats = -np.asarray(problem.compiled("hessian", objective)(best.optimum), np.float64)
    return (second + second.T) / 2


def _differences(gradient: Callable[[Floats], Floats], u: Floats, widths: Floats) -> tuple[Floats, Floats]:
    """Minus the derivative (p, p) of a gradient by central differences, extrapolated; and how much two steps differ."""

    def central(times: float) -> Floats:
        rows: Floats = np.stack(
            [(gradient(u - step) - gradient(u + step)) / (2 * step.max()) for step in np.diag(times * widths)]
        )
        return (rows + rows.T) / 2

    near, far = central(1.0), central(_RATIO)
    return (_RATIO**2 * near - far) / (_RATIO**2 - 1), near - far


def _flat_directions(
    problem: Problem, value: Callable[[Floats], float], best: _Search, information: Floats, scales: Floats, penalised: bool
) -> dict[int, Verdict]:
    """For each coordinate that has no standard error, the finding that says why."""
    names, found = problem.bijector.coordinate_names, {}
    of_line = np.concatenate([np.full(site.size, site.identity) for site in problem.bijector.sites.values()])
    for j, name in enumerate(names):
        step = np.eye(len(names))[j] * (scales[j] if of_line[j] else _STEP)
        flat = [_is_flat(value, best, sign * step) for sign in (-1.0, 1.0)]
        if all(flat):
            found[j] = _unidentified([name], "Its value changes nothing")
        elif any(flat) and not of_line[j]:
            found[j] = _at_bound(problem, name, best.optimum + (1.0 if flat[1] else -1.0) * step)
    if not np.isfinite(information).all():
        return dict.fromkeys(range(len(names)), Verdict(ERROR, "The information is not finite at the estimate;", (_start(),)))
    while together := _weak_direction(information * np.outer(scales, scales), found, 0.0 if penalised else _WEAK):
        verdict = _unidentified([names[j] for j in together], "The information is singular")
        found |= dict.fromkeys(together, verdict)
    return found


def _is_flat(value: Callable[[Floats], float], best: _Search, step: Floats) -> bool:
    """Whether nothing is lost from the optimum on along a step; values that are not finite count for nothing."""
    values = (value(best.optimum + times * step) for times in (1, 2, 4, 8))
    return not any(np.isfinite(each) and each < best.value - _FLAT for each in values)


def _weak_direction(relative: Floats, left_out: Mapping[int, Any], least: float) -> list[int]:
    """The coordinates that make up the direction of least information, where it has too little; none if it has enough."""
    kept = [j for j in range(len(relative)) if j not in left_out]
    if not kept:
        return []
    values, vectors = np.linalg.eigh(relative[np.ix_(kept, kept)])
    if values[0] > max(least, 1e-9 * values[-1]):
        return []
    return [kept[j] for j in np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)]


def _unidentified(names: list[str], reason: str) -> Verdict:
    which = names[0] if len(names) == 1 else f"the combination of {', '.join(names)}"
    finding = f"{reason}: the data do not identify {which}, which has no standard error;"
    return Verdict(ERROR, finding, (Remedy("fix it, give more data, or use {} with an informative prior", "method", "map"),))


def _at_bound(problem: Problem, name: str, beyond: Floats) -> Verdict:
    site = name.partition("[")[0]
    value = np.ravel(problem.bijector.to_params(jnp.asarray(beyond))[site])
    finding = f"The estimate of {name} is at its bound (towards {value[np.abs(value).argmin()]:.3g}) and has no standard error;"
    return Verdict(WARNING, finding, (Remedy("leave it out of the model, or use {}, which has intervals", "method", "nuts"),))


def _start() -> Remedy:
    return Remedy("give another {}", "start")


def _convergence(decrement: float, best: _Search, searches: list[_Search]) -> Findings:
    if not decrement < _DECREMENT:
        finding = (
            f"The search did not converge: the optimum may be {decrement:.2g} units of log-likelihood away ({best.message});"
        )
        yield Verdict(ERROR, finding, (Remedy("raise {}", "max_steps"), _start()))
    lower = sum(search.value < best.value - _APART for search in searches)
    if lower:
        finding = f"{lower} of {len(searches)} searches ended at a lower optimum: the likelihood has several, or is flat;"
        severity = WARNING if lower > len(searches) / 2 else INFO
        yield Verdict(severity, finding, (Remedy("raise {}", "num_starts"),))


def _covariance(information: Floats, flat: Mapping[int, Any]) -> Floats:
    """The inverse information (p, p), NaN in the rows and columns that have none."""
    covariance = np.full_like(information, np.nan)
    kept = [j for j in range(len(information)) if j not in flat]
    if kept:
        covariance[np.ix_(kept, kept)] = np.linalg.inv(information[np.ix_(kept, kept)])
    return covariance


def _decrement(gradient: Floats, information: Floats, flat: Mapping[int, Any]) -> float:
    """Newton's decrement over the coordinates that have information."""
    kept = [j for j in range(len(gradient)) if j not in flat]
    if not kept:
        return 0.0
    part = gradient[kept]
    return float(abs(part @ np.linalg.solve(information[np.ix_(kept, kept)], part)) / 2)


def _draws(noise: Floats, mean: Floats, covariance: Floats) -> Floats:
    """Draws (1, R, p) of the Gaussian from standard normal numbers (R, p); NaN in coordinates without a variance."""
    known = np.flatnonzero(np.isfinite(np.diagonal(covariance)))
    draws = np.full(noise.shape, np.nan)
    if len(known):
        draws[:, known] = mean[known] + noise[:, : len(known)] @ np.linalg.cholesky(covariance[np.ix_(known, known)]).T
    return draws[None]
