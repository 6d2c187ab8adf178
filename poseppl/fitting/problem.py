"""A fit's target: log-likelihood, prior and posterior of the params as functions of one unconstrained vector u (p,)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit, jit_formula
from poseppl.diagnostics.verdicts.verdict import Verdict
from poseppl.errors import Argument, InputError
from poseppl.filters.base import Filter
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.parameters import ParameterBijector, parameter_bijector
from poseppl.runs.run import Progress
from poseppl.smoothers.inner_filter import filter_evidence, filter_for
from poseppl.smoothers.particle_marginal import flat_start

What = Literal["value", "slope", "hessian"]
NUM_STARTING_DRAWS = 16
"""Draws of the prior of which a search starts at the best."""
MAX_FORWARD = 4
"""Params up to which gradients are forward, which is compiled sooner; with more, reverse mode takes less time."""


class Problem(NamedTuple):
    """A problem for a fitting method.

    Attributes:
        model: The compiled model, with a parameters program.
        bijector: Its params, laid out in one unconstrained vector.
        build_filter: `model -> filter`.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, or None.
        rng_key: The key of the likelihood where a method keeps it fixed.
        progress: Callback for the progress of the fit.
    """

    model: CompiledModel
    bijector: ParameterBijector
    build_filter: Callable[[CompiledModel], Filter]
    observations: Observation
    inputs: Any
    rng_key: Array
    progress: Progress | None

    @property
    def num_frames(self) -> int:
        """T."""
        return len(jax.tree.leaves(self.observations)[0])

    def bound(self, u: Array) -> CompiledModel:
        """The model with the params of u (p,)."""
        return self.model.with_params(self.bijector.to_params(u))

    def log_likelihood(self, u: Array, rng_key: Array | None = None) -> Array:
        """Log-likelihood at u (p,), a scalar; -inf where it is none."""
        key = self.rng_key if rng_key is None else rng_key
        return filter_evidence(filter_for(self.bound(u), self.build_filter), key, self.observations, self.inputs)

    def log_penalised(self, u: Array) -> Array:
        """Log-likelihood and log-prior of the constrained params, a scalar."""
        return nan_to_neg_inf(self.log_likelihood(u) + self.model.log_parameters(self.bijector.to_params(u)))

    def log_posterior(self, u: Array, rng_key: Array | None = None) -> Array:
        """Unnormalised log-density of u (p,) given the data, a scalar."""
        return nan_to_neg_inf(self.log_likelihood(u, rng_key) + self.bijector.log_prior(self.model, u))

    def compiled(self, what: What, function: str) -> Callable[[Any], Any]:
        """A function of u, or its derivatives, compiled once for all fits of the same model, builder and shapes of data."""
        program = _program(self.model, type(self), self.build_filter, what, function)
        rest = jax.tree.map(jnp.asarray, (self.observations, self.inputs, self.rng_key))
        return lambda u: program(np.asarray(u, jnp.result_type(float)), *rest)

    @property
    def filter(self) -> Filter:
        """The filter of params whose values are not known; only its declared fields mean anything."""
        return abstract_filter(self.model, self.build_filter)

    def prior_draws(self, rng_key: Array, number: int) -> Array:
        """Draws of u (number, p) from the prior."""
        return _draws_program(self.model, number)(rng_key)

    def starts(
        self,
        rng_key: Array,
        number: int,
        start: Mapping[str, Any] | None,
        value: Callable[[Any], float],
        draws: Any = None,
    ) -> Floats:
        """Starts of searches (number, p): at `start`, or at the best of a few draws of the prior.

        Args:
            rng_key: Key of the draws.
            number: How many starts.
            start: Params by name.
            value: Value of u (p,), the larger the better.
            draws: The draws, if there are some already.

        Raises:
            InputError: The value is -inf at the start, or at all draws.
        """
        if start is not None:
            flat = np.asarray(flat_start(self.bijector, start), np.float64)
            if not np.isfinite(value(flat)):
                raise InputError(
                    "the data are impossible there", field=Argument("start"), expected="params under which they are not"
                )
            return np.tile(flat, (number, 1))
        made = self.prior_draws(rng_key, num_starting_draws(number)) if draws is None else draws
        draws = np.asarray(made, np.float64)
        values = np.array([value(draw) for draw in draws])
        if not np.isfinite(values).any():
            problem = f"the data are impossible under all of {len(draws)} draws of the prior"
            raise InputError(problem, field=Argument("start"), expected="params by name under which they are not")
        best = np.argsort(-values, kind="stable")
        usable = best[np.isfinite(values[best])]
        chosen: Floats = draws[usable[np.arange(number) % len(usable)]]
        return chosen

    def advance(self, steps: int) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress.advance(steps)


@memoized_builder
def abstract_filter(model: CompiledModel, build_filter: Any) -> Filter:
    """The filter that is built for params whose values are not known; see :func:`filter_for` for the errors."""
    built: list[Filter] = []
    jax.eval_shape(
        lambda key: built.append(filter_for(model.with_params(model.sample_parameters(key)), build_filter)), jax.random.key(0)
    )
    return built[0]


def num_starting_draws(number: int) -> int:
    """Draws of the prior among which `number` starts are chosen."""
    return max(NUM_STARTING_DRAWS, number)


def draw_prior(model: CompiledModel, bijector: ParameterBijector, rng_key: Array, number: int) -> Array:
    """Draws of u (number, p) from the prior."""
    keys = jax.random.split(rng_key, number)
    return jax.vmap(lambda key: bijector.to_flat(model.sample_parameters(key)))(keys)


@memoized_builder
def _draws_program(model: CompiledModel, number: int) -> Callable[[Array], Array]:
    bijector = parameter_bijector(model)
    return jit_formula(lambda rng_key: draw_prior(model, bijector, rng_key, number), runs_once=True)


@memoized_builder
def _program(model: CompiledModel, kind: Any, build_filter: Any, what: What, function: str) -> Callable[..., Any]:
    """The function of u, data, inputs and key."""
    bijector = parameter_bijector(model)

    def of_data(u: Array, data: Any, inputs: Any, key: Array) -> Any:
        problem = kind(model, bijector, build_filter, data, inputs, key, None)
        computed: dict[str, Callable[..., Any]] = {"value": lambda f: f, "slope": slope, "hessian": second_derivatives}
        return computed[what](getattr(problem, function))(u)

    return jit_formula(of_data) if abstract_filter(model, build_filter).closed_form else jit(of_data)


def slope(function: Callable[[Array], Array]) -> Callable[[Array], tuple[Array, Array]]:
    """Value () and gradient (p,) of a function of (p,), forward where p is small."""

    def both(u: Array) -> tuple[Array, Array]:
        if len(u) > MAX_FORWARD:
            return jax.value_and_grad(function)(u)
        gradient, value = jax.jacfwd(lambda u: (function(u),) * 2, has_aux=True)(u)
        return value, gradient

    return both


def second_derivatives(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Second derivatives (p, p), forward twice.

    Reverse mode takes the derivatives of a scan apart, without the rules of their functions (`custom_jvp`). Forward over
    reverse is NaN then where states have no noise: QR of a singular root has no derivative.
    """
    return jax.jacfwd(jax.jacfwd(function))


class Estimate(NamedTuple):
    """Result of a fitting method.

    Attributes:
        unconstrained: The estimate (p,); None if it is the mean of the draws.
        covariance: Covariance of u (p, p), NaN where it is unknown; None if it is that of the draws.
        draws: Draws of u (M, R, p).
        statistics: Statistics of each draw by name, (M, R).
        trace: The objective, one value a step; empty where there is none.
        attrs: Further attributes, of types that JSON has.
        findings: Problems that were detected.
    """

    unconstrained: Floats | None
    covariance: Floats | None
    draws: Floats
    statistics: Mapping[str, Any] = {}
    trace: Any = ()
    attrs: Mapping[str, Any] = {}
    findings: tuple[Verdict, ...] = ()


def likelihood_error(problem: Problem, rng_key: Array, u: Any, number: int = 16) -> dict[str, float]:
    """Attributes: the log of the mean likelihood at u (p,) over runs of the filter, its standard error, the SD of one run."""
    runs = jit(lambda u: jax.vmap(lambda key: problem.log_likelihood(u, key))(jax.random.split(rng_key, number)))
    values = np.asarray(runs(jnp.asarray(u, jnp.result_type(float))), np.float64)
    peak = values.max()
    if not np.isfinite(peak):
        return {"log_likelihood": float("-inf"), "log_likelihood_error": float("nan"), "log_likelihood_sd": float("nan")}
    shares = np.exp(values - peak)
    error = float(shares.std(ddof=1) / shares.mean() / np.sqrt(number))
    finite = values[np.isfinite(values)]
    spread = float(finite.std(ddof=1)) if len(finite) > 1 else float("nan")
    return {
        "log_likelihood": float(peak + np.log(shares.mean())),
        "log_likelihood_error": error,
        "log_likelihood_sd": spread,
    }
